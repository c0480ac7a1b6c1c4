# SPDX-License-Identifier: Apache-2.0
"""The action FollowJointTrajectory of control_msgs, where that is installed: both its ends."""

from __future__ import annotations

from typing import Any, Protocol

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory

from calib_model.topics import follow_action

WATCH = 0.02  # s between looks whether a goal is done


class Follower(Protocol):
    """An arm that follows trajectories."""

    @property
    def busy(self) -> bool:
        """Whether a trajectory is still under way."""

    @property
    def failure(self) -> str:
        """What stopped the arm for good; empty while it works."""

    def take(self, message: JointTrajectory) -> str:
        """Follow a trajectory from now on, or say why not."""

    def hold(self) -> None:
        """Stop at once."""


def action_type() -> Any:
    """The action's type, None where control_msgs is not installed."""
    try:
        from control_msgs.action import FollowJointTrajectory
    except ImportError:
        return None
    return FollowJointTrajectory


def serve_goals(node: Node, controller: str, arm: Follower) -> Any:
    """The controller's action server on `node`, None where control_msgs is not installed."""
    kind = action_type()
    return None if kind is None else _Goals(node, kind, controller, arm)


class _Goals:
    """Takes goals as joint_trajectory_controller does: each replaces the one before."""

    def __init__(self, node: Node, kind: Any, controller: str, arm: Follower) -> None:
        self._node, self._kind, self._arm = node, kind, arm
        self._over: Future | None = None
        self._server = ActionServer(
            node,
            kind,
            follow_action(controller),
            self._run,
            goal_callback=self._on_goal,
            cancel_callback=self._on_cancel,
        )
        self._timer = node.create_timer(WATCH, self._look)

    def _on_goal(self, goal: Any) -> GoalResponse:
        if reason := self._arm.take(goal.trajectory):
            self._node.get_logger().warning(f'rejected: {reason}')
            return GoalResponse.REJECT
        self._end('replaced by another goal')
        return GoalResponse.ACCEPT

    def _on_cancel(self, _: Any) -> CancelResponse:
        self._arm.hold()
        self._end('cancelled')
        return CancelResponse.ACCEPT

    def _look(self) -> None:
        if self._over is None:
            return
        if self._arm.failure:
            self._end(self._arm.failure)
        elif not self._arm.busy:
            self._end('')

    def _end(self, how: str) -> None:
        if self._over is not None and not self._over.done():
            self._over.set_result(how)

    async def _run(self, handle: Any) -> Any:
        self._over = over = Future()
        how = await over
        result = self._kind.Result()
        if not how:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            result.error_code, result.error_string = result.PATH_TOLERANCE_VIOLATED, how
            handle.abort()
        return result


def goal_sender(node: Node, controller: str) -> GoalSender | None:
    """The controller's action client on `node`, None where control_msgs is not installed."""
    kind = action_type()
    return None if kind is None else GoalSender(node, kind, controller)


class GoalSender:
    """Sends trajectories as goals, each in place of the one before; `problem` says why the last one
    was not followed."""

    def __init__(self, node: Node, kind: Any, controller: str) -> None:
        self._kind, self._controller = kind, controller
        self._client = ActionClient(node, kind, follow_action(controller))
        self._sent = 0
        self.problem = ''

    @property
    def ready(self) -> bool:
        """Whether a server answers."""
        return bool(self._client.server_is_ready())

    def send(self, message: JointTrajectory) -> None:
        """Send a goal."""
        self._sent += 1
        number, self.problem = self._sent, ''
        sent = self._client.send_goal_async(self._kind.Goal(trajectory=message))
        sent.add_done_callback(lambda future: self._answered(number, future.result()))

    def _answered(self, number: int, handle: Any) -> None:
        if number != self._sent:
            return
        if not handle.accepted:
            self.problem = f'{self._controller} has rejected the trajectory, see its log'
            return
        done = handle.get_result_async()
        done.add_done_callback(lambda future: self._ended(number, future.result()))

    def _ended(self, number: int, answer: Any) -> None:
        if number == self._sent and answer.status != GoalStatus.STATUS_SUCCEEDED:
            words = answer.result.error_string or f'error code {answer.result.error_code}'
            self.problem = f'{self._controller} has aborted the trajectory: {words}'

    def close(self) -> None:
        """Send no more."""
        self._client.destroy()
