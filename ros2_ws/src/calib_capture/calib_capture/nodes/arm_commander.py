# SPDX-License-Identifier: Apache-2.0
"""Commands the arm, by topic or by action: one capture at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from trajectory_msgs.msg import JointTrajectory

from calib_capture.measuring import RunError
from calib_capture.motion import Trajectory
from calib_capture.nodes.messages import joint_trajectory
from calib_capture.nodes.trajectory_action import GoalSender, goal_sender
from calib_capture.recording import trajectory_cdr
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_POSES, CONTROLLER, commanded, follow_action

PARTICIPANT = 12  # bytes of a gid that all of one process share
LAST_WORDS = 0.5  # s for the arm to acknowledge the last command
NAMED_WITHIN = 1.0  # s until all are known
TOPIC, ACTION, AUTO = 'topic', 'action', 'auto'
UNKNOWN = 'NODE_NAME_UNKNOWN'


class ArmCommander:
    """The commands' publisher, there only while a capture is under way: so others see it.

    Commands go by the action of the controller where they are to: `how` is topic, action or auto,
    which is the action where a server answers. `problem` says what became of a command that was
    not followed.
    """

    def __init__(self, node: Node, controller: str = CONTROLLER, how: str = TOPIC) -> None:
        self._node = node
        self.topic, self._controller, self._how = commanded(controller), controller, how
        self._action: GoalSender | None = None
        self._publisher: Publisher | None = None
        self._own: tuple[int, ...] = ()

    def refuse_rivals(self) -> None:
        """Nothing, when the arm is ours alone; of two that begin together, one goes on.

        Raises:
            RunError: another capture commands the arm; names its node.
        """
        if self._rivals():
            raise RunError(
                f'{self.topic.name}: another capture commands the arm '
                f'({node_names(self._rivals)}): start when it is done'
            )

    def take(self) -> None:
        """Command the arm from now on.

        Raises:
            RunError: another capture does; names its node.
        """
        self.refuse_rivals()
        before = {_gid(at) for at in self._published()}
        self._publisher = self._node.create_publisher(
            JointTrajectory, self.topic.relative, qos_of(self.topic)
        )
        if self._how != TOPIC:
            self._action = goal_sender(self._node, self._controller)
        if self._how == ACTION and self._action is None:
            raise RunError("parameter 'command': action, but control_msgs is not installed")
        new = {_gid(at) for at in self._published()} - before
        self._own = max(new, default=())

    def heard(self) -> bool:
        """Whether an arm listens."""
        if self._action is not None and self._action.ready:
            return True
        listeners = self._publisher.get_subscription_count() if self._publisher else 0
        return self._how != ACTION and bool(listeners)

    @property
    def where(self) -> str:
        """The topic or the action that an arm is to listen to."""
        return follow_action(self._controller) if self._how == ACTION else self.topic.name

    def send(self, names: Sequence[str], trajectory: Trajectory) -> bytes:
        """Pass on a command, while it is ours to do so; its message on `topic`, by whichever way it
        went, as CDR bytes."""
        data = trajectory_cdr(names, trajectory)
        if self._action is not None and self._action.ready:
            self._action.send(joint_trajectory(names, trajectory))
        elif self._publisher is not None:
            self._publisher.publish(data)
        return data

    @property
    def problem(self) -> str:
        """Why the last command is not followed, as the controller says; empty when it is."""
        return self._action.problem if self._action is not None else ''

    def leave(self) -> None:
        """Command no more; further calls do nothing."""
        if self._publisher is None:
            return
        self._publisher.wait_for_all_acked(Duration(seconds=LAST_WORDS))
        self._node.destroy_publisher(self._publisher)
        if self._action is not None:
            self._action.close()
        self._publisher, self._own, self._action = None, (), None

    def _published(self) -> list[Any]:
        return list(self._node.get_publishers_info_by_topic(self.topic.relative))

    def _rivals(self) -> list[Any]:
        poses = self._node.get_publishers_info_by_topic(CAPTURE_POSES.relative)
        captures = {_gid(at)[:PARTICIPANT] for at in poses}
        return [
            at
            for at in self._published()
            if (not self._own or _gid(at) < self._own) and _gid(at)[:PARTICIPANT] in captures
        ]


def node_names(find: Callable[[], Iterable[Any]]) -> str:
    """The nodes of the endpoints that `find` returns, as they are called.

    An endpoint may be known a moment before its node's name is.
    """
    end = time.monotonic() + NAMED_WITHIN
    while True:
        found = [at for at in find() if UNKNOWN not in at.node_name]
        if found and len(found) == len(list(find())) or time.monotonic() > end:
            names = (f'{at.node_namespace.rstrip("/")}/{at.node_name}' for at in found)
            return ', '.join(sorted(names)) or 'nodes unknown'
        time.sleep(0.02)


def _gid(endpoint: Any) -> tuple[int, ...]:
    return tuple(endpoint.endpoint_gid)
