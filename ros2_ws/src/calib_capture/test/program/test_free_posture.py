# SPDX-License-Identifier: Apache-2.0
"""A simulated arm begins where nothing is touched."""

from __future__ import annotations

import numpy as np
import pytest

from calib_capture.motion import CollisionCheck, bodies_of
from calib_capture.program.free_posture import AWAY, posture_to_begin_in
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe

ARMS = ('kuka_kr5_sixx_r650', 'kuka_kr10_r1100_sixx', 'kuka_lbr_iiwa14', 'ur5')


@pytest.mark.parametrize('name', ARMS)
def test_it_is_zero_where_that_is_free_and_else_a_posture_within_the_limits(name, config):
    arm = parse_arm((config / 'arms' / f'{name}.yaml').read_text(), name)
    probe = parse_probe((config / 'probes' / 'active_trihedron.yaml').read_text(), 'probe')
    gauge = parse_gauge((config / 'gauges' / 'ball_bar_kr5.yaml').read_text(), 'gauge')
    found = posture_to_begin_in(arm, probe, gauge)
    check = CollisionCheck(arm, bodies_of(arm, probe, gauge))
    check.put_gauge(AWAY, -1)
    lower, upper = arm.limits.T
    assert not check.touches(found)
    assert (lower <= found).all() and (found <= upper).all()
    zero = np.clip(np.zeros(arm.n), lower, upper)
    assert check.touches(zero) != np.array_equal(found, zero)


def test_of_some_shipped_arm_zero_is_not_free(config):
    text = (config / 'arms' / 'ur5.yaml').read_text()
    probe = parse_probe((config / 'probes' / 'active_trihedron.yaml').read_text(), 'probe')
    gauge = parse_gauge((config / 'gauges' / 'ball_bar_kr5.yaml').read_text(), 'gauge')
    assert posture_to_begin_in(parse_arm(text, 'ur5'), probe, gauge).any()
