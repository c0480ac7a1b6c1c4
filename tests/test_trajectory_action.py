# SPDX-License-Identifier: Apache-2.0
"""Commands by the action FollowJointTrajectory; on machines that have control_msgs."""

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
CONTROL = pytest.importorskip('control_msgs.action', reason='control_msgs is not installed')
from process_graph import CONFIG, Graph, graph as graph, peer as peer  # noqa: F401
from rclpy.action import ActionClient
from sensor_msgs.msg import JointState

from calib_capture.motion import Leg, motion_limits
from calib_capture.nodes.messages import joint_trajectory
from calib_model.descriptions import parse_arm, read_description

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
GOAL = np.array([0.4, 0.3, -0.2, 0.5, 0.7, -0.6])
ABORTED, SUCCEEDED = 6, 4


class Controller:
    """The action's client, and the arm's limits."""

    def __init__(self, peer):
        self._peer = peer
        self.arm = read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
        self._states = peer.heard(JointState, '/joint_states')
        self._client = ActionClient(
            peer.node, CONTROL.FollowJointTrajectory, '/arm_controller/follow_joint_trajectory'
        )
        while not (self._client.server_is_ready() and self._states):
            peer.spin(0.05)

    def where(self):
        self._peer.spin(0.1)
        return np.array(self._states[-1].position)

    def message(self, posture):
        leg = Leg(self.where(), motion_limits(self.arm, 10.0, 100.0))
        leg.to(np.asarray(posture))
        return joint_trajectory(self.arm.joint_names, leg.trajectory())

    def sent(self, message):
        goal = CONTROL.FollowJointTrajectory.Goal(trajectory=message)
        return self.done(self._client.send_goal_async(goal))

    def done(self, future):
        while not future.done():
            self._peer.spin(0.02)
        return future.result()


def test_goals_are_followed_and_what_the_topic_rejects_is_rejected(graph: Graph, peer):
    graph.arm()
    controller = Controller(peer)
    handle = controller.sent(controller.message(GOAL))
    assert handle.accepted
    answer = controller.done(handle.get_result_async())
    assert (answer.status, answer.result.error_code) == (SUCCEEDED, 0)
    assert np.abs(controller.where() - GOAL).max() < 1e-6
    named = controller.message(np.zeros(6))
    named.joint_names[2] = 'elbow'
    empty = controller.message(np.zeros(6))
    empty.points = []
    assert not controller.sent(named).accepted
    assert not controller.sent(empty).accepted
    assert np.abs(controller.where() - GOAL).max() < 1e-6


def test_a_goal_ends_when_another_takes_its_place_and_when_the_arm_fails(graph: Graph, peer):
    graph.arm(scale=1.0)
    controller = Controller(peer)
    first = controller.sent(controller.message(GOAL))
    jump = controller.message(np.zeros(6))  # from rest, while the arm moves
    second = controller.sent(jump)
    answer = controller.done(first.get_result_async())
    assert answer.status == ABORTED
    assert answer.result.error_string == 'replaced by another goal'
    answer = controller.done(second.get_result_async())
    assert answer.status == ABORTED
    assert 'limit' in answer.result.error_string
    assert not controller.sent(controller.message(GOAL)).accepted


def test_a_capture_commands_by_it_and_tells_why_it_is_not_followed(graph: Graph, peer):
    arm = graph.arm()
    graph.probe()
    capture = graph.capture(poses=3, command='action')
    code, line = graph.ended(capture)
    assert code == 0, line
    assert graph.right() == 6
    controller = Controller(peer)
    controller.sent(controller.message(GOAL))
    controller.sent(controller.message(np.zeros(6)))
    graph.until(arm, 'FAULT')
    capture = graph.capture('again', poses=3, command='action', output=graph.folder / 'other')
    code, line = graph.ended(capture)
    assert code == 2
    assert line.endswith('other: arm_controller has rejected the trajectory, see its log')
