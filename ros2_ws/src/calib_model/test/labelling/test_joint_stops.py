# SPDX-License-Identifier: Apache-2.0
"""Postures from joint states alone."""

from __future__ import annotations

import numpy as np
import pytest

from calib_model.arrays import Array
from calib_model.labelling.joint_stops import single_states, spaced, stops, way
from calib_model.stamps import SECOND

DWELL, SLOW = 0.1, 0.02
POSTURES = np.array([[0.1, -0.4, 0.9], [0.5, -0.1, 0.7], [0.9, 0.3, 0.2]])


def smooth(count: int) -> Array:
    u = np.linspace(0.0, 1.0, count, endpoint=False)[:, None]
    return u**2 * (3 - 2 * u)


def held_and_moved(hold: int, move: int) -> Array:
    parts: list[Array] = []
    for before, posture in zip([POSTURES[0], *POSTURES[:-1]], POSTURES, strict=True):
        if parts:
            parts.append(before + (posture - before) * smooth(move))
        parts.append(np.tile(posture, (hold, 1)))
    return np.concatenate(parts)


def stamps(joints: Array, rate: float) -> np.ndarray:
    return np.round(np.arange(len(joints)) * SECOND / rate).astype(np.int64)


@pytest.mark.parametrize(('rate', 'hold', 'move'), [(125.0, 40, 60), (1000.0, 150, 900), (8, 4, 6)])
def test_an_arm_that_stands_exactly_gives_exactly_these_postures(
    rate: float, hold: int, move: int
) -> None:
    joints = held_and_moved(hold, move)
    found = stops(stamps(joints, rate), joints, DWELL, SLOW)
    assert np.array_equal(found.joints, POSTURES)


def test_noise_of_encoders_and_a_drifting_hand_leave_one_posture_for_each_stop() -> None:
    joints = held_and_moved(250, 80)
    draw = np.random.default_rng(2)
    shaken = joints + draw.normal(0.0, 8e-5, joints.shape)
    shaken += 2e-3 * np.sin(np.arange(len(joints)) / 90)[:, None]
    found = stops(stamps(joints, 125.0), shaken, DWELL, SLOW)
    assert len(found.stamp) == 3
    assert np.abs(found.joints - POSTURES).max() < 3e-3
    assert found.states.min() > 50


def test_a_posture_that_is_come_back_to_counts_again() -> None:
    there = held_and_moved(40, 60)
    joints = np.concatenate([there, there[::-1]])
    found = stops(stamps(joints, 125.0), joints, DWELL, SLOW)
    assert np.array_equal(found.joints, POSTURES[[0, 1, 2, 1, 0]])


def test_a_stop_that_is_broken_by_a_push_is_one_posture() -> None:
    held = np.tile(POSTURES[1], (60, 1))
    push = POSTURES[1] + 0.03 * np.sin(np.linspace(0.0, np.pi, 12))[:, None]
    joints = np.concatenate([held, push, held[:40]])
    assert len(stops(stamps(joints, 125.0), joints, DWELL, SLOW).stamp) == 1


def test_an_arm_in_motion_has_no_stop() -> None:
    joints = np.linspace(POSTURES[0], POSTURES[2], 500)
    assert not len(stops(stamps(joints, 125.0), joints, DWELL, SLOW).stamp)


def test_states_far_apart_are_postures_and_states_of_a_motion_are_none() -> None:
    found = single_states(stamps(POSTURES, 2.0), POSTURES)
    assert found is not None
    assert np.array_equal(found.joints, POSTURES)
    motion = np.linspace(POSTURES[0], POSTURES[2], 500)
    assert single_states(stamps(motion, 125.0), motion) is None


def test_noise_is_no_way() -> None:
    draw = np.random.default_rng(4)
    joints = np.tile(POSTURES[0], (4000, 1)) + draw.normal(0.0, 1e-4, (4000, 3))
    assert way(stamps(joints, 125.0), joints) == 0.0
    moved = np.linspace(POSTURES[0], POSTURES[1], 600)
    length = np.linalg.norm(POSTURES[1] - POSTURES[0])
    assert way(stamps(moved, 125.0), moved) == pytest.approx(length, rel=0.05)


def test_spaced_postures_are_at_least_so_far_apart() -> None:
    joints = np.linspace(POSTURES[0], POSTURES[2], 777)
    rows = spaced(joints, 0.15)
    steps = np.linalg.norm(np.diff(joints[rows], axis=0), axis=1)
    assert steps.min() >= 0.15
    assert steps.max() < 0.16
