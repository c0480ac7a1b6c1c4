# SPDX-License-Identifier: Apache-2.0
"""A stop keeps the limits of a controller that checks them, and comes soon enough."""

from __future__ import annotations

import numpy as np
import pytest

from calib_capture.measuring.commanded_motion import (
    AHEAD,
    AUTO,
    JOINTS,
    LEAD,
    NONE,
    CommandedMotion,
)
from calib_capture.motion import Leg, StrictController, Trajectory, motion_limits
from calib_capture.motion.interpolated_motion import InterpolatedMotion
from calib_model.instruments import Arm
from calib_model.stamps import SECOND

EPOCH = 1_790_000_000 * SECOND
OTHER = 3600 * SECOND  # ns between the arm's clock and ours where they are two
DELAY = 4_000_000  # ns that joint states are on their way


class Cell:
    """An arm behind a strict controller, and what a capture knows of it."""

    def __init__(self, arm: Arm, seed: int, shared: bool = True, stamps: str = AUTO) -> None:
        self.draw = np.random.default_rng(seed)
        limits = motion_limits(arm, 10.0, 100.0)
        lower, upper = arm.limits.T + np.array([[0.1], [-0.1]])
        here = np.clip(self.draw.uniform(-0.5, 0.5, arm.n), lower, upper)
        leg = Leg(here, limits.share(self.draw.uniform(0.2, 1.0), 0.85, 0.85))
        for step in (0.4, 0.4, 0.02):
            leg.to(np.clip(leg.here + self.draw.uniform(-step, step, arm.n), lower, upper))
        leg.rest(0.3)
        self.way, self.said, self.shared = leg.trajectory(), list[str](), shared
        self.controller = StrictController(arm, limits, EPOCH, self.said.append)
        self.controller._motion = InterpolatedMotion.resting(here)
        self.motion = CommandedMotion(limits, stamps)
        self.until(0.0)

    def until(self, seconds: float, begin: float = 0.0) -> None:
        """The joint states until then are seen."""
        for stamp in EPOCH + (np.arange(begin, seconds + 1e-9, 0.01) * SECOND).astype(int):
            wall = int(stamp) + DELAY if self.shared else int(stamp) - OTHER
            joints = self.controller.at(int(stamp)).position
            now = (int(stamp) + DELAY) / SECOND
            self.motion.see(joints, int(stamp), now, wall)

    def follow(self, trajectory: Trajectory, seconds: float, stamp: int) -> None:
        self.controller.follow(trajectory, EPOCH + round(seconds * SECOND), stamp)


@pytest.mark.parametrize(('shared', 'stamps'), [(True, AUTO), (False, JOINTS)])
def test_whenever_it_is_asked_for_and_comes_a_stop_is_within_the_limits(kr5, shared, stamps):
    asked = 0
    for seed in range(25):
        cell = Cell(kr5, seed, shared, stamps)
        sent = cell.motion.begin(cell.way, EPOCH / SECOND)
        assert abs(sent.stamp - EPOCH - LEAD * SECOND) < 0.1 * SECOND
        cell.follow(sent, 0.02, sent.stamp)
        when = cell.draw.uniform(0.05, sent.duration + LEAD)
        cell.until(when, 0.02)
        found = cell.motion.stop(EPOCH / SECOND + when)
        if found is None:  # it is over before a stop could be
            assert when > sent.duration + LEAD - 2 * AHEAD
            continue
        asked += 1
        comes = when + cell.draw.uniform(0.0, 0.8 * AHEAD)
        cell.controller.at(EPOCH + round(comes * SECOND))
        cell.follow(found, comes, found.stamp)
        rests = found.stamp + round(found.duration * SECOND)
        assert rests - EPOCH - when * SECOND < 1.0 * SECOND
        state = cell.controller.at(rests + 1)
        assert np.abs(state.velocity).max() == 0
        assert cell.said == []
    assert asked > 18


def test_an_arm_that_begins_at_once_in_spite_of_the_stamp_is_stopped_where_it_is(kr5):
    cell = Cell(kr5, 3)
    sent = cell.motion.begin(cell.way, EPOCH / SECOND)
    cell.follow(sent, 0.02, 0)
    cell.until(1.0, 0.02)
    found = cell.motion.stop(EPOCH / SECOND + 1.0)
    assert found is not None and found.stamp == 0
    cell.follow(found, 1.0 + 0.01, found.stamp)
    cell.controller.at(EPOCH + 4 * SECOND)
    assert cell.said == []


@pytest.mark.parametrize(('shared', 'stamps'), [(False, AUTO), (True, NONE)])
def test_no_stamp_is_given_to_an_arm_whose_clock_is_not_ours_or_that_takes_none(
    kr5, shared, stamps
):
    cell = Cell(kr5, 5, shared, stamps)
    assert cell.motion.begin(cell.way, EPOCH / SECOND).stamp == 0
    assert cell.motion.stop(EPOCH / SECOND) is None or cell.said == []


@pytest.mark.parametrize('seed', [2, 8])
def test_before_it_has_begun_the_arm_is_told_to_stay(kr5, seed):
    cell = Cell(kr5, seed)
    sent = cell.motion.begin(cell.way, EPOCH / SECOND)
    cell.follow(sent, 0.02, sent.stamp)
    cell.until(0.1, 0.02)
    found = cell.motion.stop(EPOCH / SECOND + 0.1)
    assert found is not None
    cell.follow(found, 0.12, found.stamp)
    state = cell.controller.at(EPOCH + 9 * SECOND)
    assert np.array_equal(state.position, cell.way.positions[0]) and cell.said == []


def test_a_simulation_faster_than_real_time_is_not_told_to_stop_where_nobody_knows_it_is(kr5):
    cell, wall = Cell(kr5, 11, shared=False), EPOCH / SECOND
    for _ in range(2):
        sent = cell.motion.begin(cell.way, wall)
        for seconds in np.arange(0.0, sent.duration, 0.05):
            wall += 1e-4
            cell.motion.see(cell.way.positions[0], EPOCH + round(seconds * SECOND), wall)
        assert cell.motion.stop(wall) is None
    cell.motion.begin(cell.way, wall)
    assert cell.motion.stop(wall + 0.01) is None  # of this motion nothing has been seen yet
