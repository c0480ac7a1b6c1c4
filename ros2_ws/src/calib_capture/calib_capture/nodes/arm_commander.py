# SPDX-License-Identifier: Apache-2.0
"""ArmCommander the arm: one capture at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from trajectory_msgs.msg import JointTrajectory

from calib_capture.recording import RunError
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_POSES, JOINT_TRAJECTORY

PARTICIPANT = 12  # bytes of a gid that all of one process share
LAST_WORDS = 0.5  # s for the arm to acknowledge the last command
NAMED_WITHIN = 1.0  # s until all are known
UNKNOWN = 'NODE_NAME_UNKNOWN'


class ArmCommander:
    """The commands' publisher, there only while a capture is under way: so others see it."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._own: tuple[int, ...] = ()

    def refuse_rivals(self) -> None:
        """Nothing, when the arm is ours alone; of two that begin together, one goes on.

        Raises:
            RunError: another capture commands the arm; names its node.
        """
        if self._rivals():
            raise RunError(
                f'{JOINT_TRAJECTORY.name}: another capture commands the arm '
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
            JointTrajectory, JOINT_TRAJECTORY.relative, qos_of(JOINT_TRAJECTORY)
        )
        new = {_gid(at) for at in self._published()} - before
        self._own = max(new, default=())

    def heard(self) -> bool:
        """Whether an arm listens."""
        return self._publisher is not None and bool(self._publisher.get_subscription_count())

    def send(self, message: JointTrajectory) -> None:
        """Pass on a command, while it is ours to do so."""
        if self._publisher is not None:
            self._publisher.publish(message)

    def leave(self) -> None:
        """Command no more; further calls do nothing."""
        if self._publisher is None:
            return
        self._publisher.wait_for_all_acked(Duration(seconds=LAST_WORDS))
        self._node.destroy_publisher(self._publisher)
        self._publisher, self._own = None, ()

    def _published(self) -> list[Any]:
        return list(self._node.get_publishers_info_by_topic(JOINT_TRAJECTORY.relative))

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
