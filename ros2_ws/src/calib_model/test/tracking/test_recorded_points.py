# SPDX-License-Identifier: Apache-2.0
"""A recording of a tracker's points and of joint states is paired as it would be live."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_model.bags import BagWriter, cdr
from calib_model.descriptions import arm_yaml
from calib_model.errors import BagError
from calib_model.instruments import Arm
from calib_model.stamps import SECOND
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS, JOINT_STATES
from calib_model.tracking import read_tracked

RATE, STAND, MOVE = 0.02, 0.6, 0.2
BEGIN = 1_650_000_000 * SECOND
POSTURES = np.random.default_rng(4).uniform(-1, 1, (3, 6))


def at(seconds: float) -> int:
    return BEGIN + round(seconds * SECOND)


def recorded(
    folder: Path,
    arm: Arm,
    moments: list[float],
    states: bool = True,
    described: bool = True,
    stamped: bool = True,
    joints: np.ndarray | None = None,
) -> Path:
    """A bag as `ros2 bag record` writes it: points at some moments of an arm that goes from posture
    to posture and stands in each."""
    path, messages = folder / 'bag', []
    if states:
        for number, (here, there) in enumerate(zip(POSTURES, POSTURES[1:], strict=False)):
            for step in range(round((STAND + MOVE) / RATE)):
                share = max(step * RATE - STAND, 0.0) / MOVE
                stamp = at(number * (STAND + MOVE) + step * RATE)
                posture = (1 - share) * here + share * there
                state = cdr.joint_state(stamp, 'base', list(arm.joint_names), posture)
                messages.append((stamp, JOINT_STATES, cdr.encode(state)))
    for number, moment in enumerate(moments):
        point = cdr.measured_point(
            at(moment) if stamped else 0,
            'tracker',
            'nest',
            2,
            np.zeros(0) if joints is None else joints,
            np.array([0.1, 0.2, 0.3 + number]),
            np.zeros(4),
            0.0,
        )
        # the tracker takes a while to say it
        messages.append((at(moment) + SECOND // 10, CAPTURE_POINTS, cdr.encode(point)))
    with BagWriter(path) as bag:
        if described:
            bag.write_message(ARM_DESCRIPTION, cdr.string(arm_yaml(arm)), BEGIN)
        for stamp, topic, data in sorted(messages, key=lambda each: each[0]):
            bag.write(topic, data, stamp, stamp)
    return path


def test_each_point_gets_the_posture_it_was_measured_in(tmp_path, kr5):
    found = read_tracked(recorded(tmp_path, kr5, [0.4, 0.7, 1.25]))
    points = found.measured.points
    np.testing.assert_allclose(points.joints, POSTURES[:2], atol=1e-12)
    np.testing.assert_array_equal(points.position[:, 2], [0.3, 2.3])
    assert points.stamp.tolist() == [at(0.4), at(1.25)]
    assert found.lines[-1].endswith(
        '2 of 3 points paired with /joint_states; left out: the arm moves 1'
    )


def test_points_that_have_their_joints_keep_them(tmp_path, kr5):
    found = read_tracked(recorded(tmp_path, kr5, [0.4, 0.7], joints=POSTURES[2]))
    np.testing.assert_array_equal(found.measured.points.joints, POSTURES[[2, 2]])
    assert found.lines == ()


def test_an_arm_stands_in_for_one_that_was_not_recorded(tmp_path, kr5):
    path = recorded(tmp_path, kr5, [0.4], described=False)
    assert len(read_tracked(path, kr5).measured.points) == 1
    with pytest.raises(BagError, match='arm_description: give --arm arm.yaml'):
        read_tracked(path)


def test_points_without_stamps_go_by_when_they_were_recorded_where_that_is_said(tmp_path, kr5):
    path = recorded(tmp_path, kr5, [0.35, 1.15], stamped=False)
    with pytest.raises(BagError, match='no stamps in their headers: --stamps record'):
        read_tracked(path)
    found = read_tracked(path, stamps='record')
    np.testing.assert_allclose(found.measured.points.joints, POSTURES[:2], atol=1e-12)


def test_points_that_nothing_tells_the_joints_of_are_refused(tmp_path, kr5):
    with pytest.raises(BagError, match=r'no joints, and there is no /joint_states .*import_points'):
        read_tracked(recorded(tmp_path, kr5, [0.4], states=False))
    (tmp_path / 'other').mkdir()
    with pytest.raises(BagError, match=r'none of 2 points is .* moves 1, joint states are missing'):
        read_tracked(recorded(tmp_path / 'other', kr5, [0.7, 99.0]))
