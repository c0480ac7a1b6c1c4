# SPDX-License-Identifier: Apache-2.0
"""The pace of the arm's time is told while it moves, and outlasts its rest."""

from __future__ import annotations

import numpy as np
import pytest

from calib_capture.measuring.arm_pace import ArmPace


def seen(pace: ArmPace, begin: tuple[float, float], arm: float, wall: float, count: int) -> None:
    """States over `arm` s that take `wall` s to come, from `begin` on."""
    for part in np.linspace(0.0, 1.0, count):
        pace.see(begin[0] + part * arm, begin[1] + part * wall, moves=True)


@pytest.mark.parametrize('scale', [0.3, 2.0, 40.0, 90.0])
def test_a_simulation_has_its_own(scale):
    pace = ArmPace()
    pace.begin()
    seen(pace, (50.0, 900.0), 4.0, 4.0 / scale, 60)
    assert pace.known == pytest.approx(scale, rel=0.1)


def test_what_was_seen_holds_while_the_arm_rests_and_when_the_next_motion_begins():
    pace = ArmPace()
    pace.begin()
    seen(pace, (0.0, 0.0), 15.0, 0.1, 150)
    for second in range(1, 90):
        pace.see(15.0 + second, 0.1 + second, moves=False)
    pace.begin()
    assert pace.known == pytest.approx(100.0, rel=0.1)
    pace.see(104.1, 89.11, moves=True)
    assert pace.known > 50
    seen(pace, (104.1, 89.11), 2.0, 2.0, 100)  # it was set to real time
    assert pace.known == 1.0


@pytest.mark.parametrize('leap', [-3600.0, -0.9, 0.7, 37.0])
def test_a_clock_that_is_set_while_a_real_arm_moves_is_no_pace(leap):
    pace = ArmPace()
    pace.begin()
    seen(pace, (10.0, 3.0), 0.5, 0.5, 50)
    seen(pace, (10.5 + leap, 3.51), 1.5, 1.5, 150)
    assert pace.known == 1.0


def test_messages_that_wait_and_then_come_at_once_are_real_time():
    pace = ArmPace()
    pace.begin()
    for arm in np.arange(0.0, 3.0, 0.01):
        late = 1.4 if 1.0 <= arm < 1.4 else arm
        pace.see(100.0 + arm, late, moves=True)
    assert pace.known == 1.0
