# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory

from calib_capture.motion import Trajectory
from calib_capture.nodes.messages import joint_trajectory
from calib_capture.recording.trajectory_bytes import read_trajectory_cdr, trajectory_cdr


def some(n, count):
    rng = np.random.default_rng(n)
    fields = (rng.normal(0, 1, (count, n)) for _ in range(3))
    return Trajectory(np.cumsum(rng.uniform(0.1, 2.0, count)), *fields)


@pytest.mark.parametrize('names', ['abc', ('a', 'bc', 'def', 'ghij'), ('joint_1', 'j2'), ('x',)])
def test_the_bytes_say_to_rclpy_what_was_given_and_come_back(names):
    given = some(len(names), 5)
    data = trajectory_cdr(names, given)
    message = joint_trajectory(names, given)
    assert deserialize_message(data, JointTrajectory) == message
    back = read_trajectory_cdr(data, names)
    assert np.array_equal(back.accelerations, given.accelerations)
    assert np.abs(back.seconds - given.seconds).max() < 1e-9


@pytest.mark.parametrize('change', ['joint_names', 'points', 'velocities', 'stamp', 'effort'])
def test_any_other_message_is_left_to_rclpy(change):
    message = joint_trajectory(('a', 'b'), some(2, 3))
    if change == 'joint_names':
        message.joint_names = ['b', 'a']
    elif change == 'points':
        message.points = []
    elif change == 'stamp':
        message.header.stamp.sec = 5
    else:
        setattr(message.points[1], change, [] if change == 'velocities' else [1.0, 2.0])
    assert read_trajectory_cdr(bytes(serialize_message(message)), ('a', 'b')) is None
