# SPDX-License-Identifier: Apache-2.0
"""An arm that a test puts from posture to posture, on a graph of its own."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

from calib_bringup.domains import held_domain
from calib_model.topics import JOINT_STATES


class PosedArm:
    """Publishes the joints (n,) in which it is, which go on by `way` from state to state."""

    def __init__(self, context: rclpy.Context, names: list[str]) -> None:
        self.node = rclpy.create_node('posed', context=context)
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.node)
        self.names, self.joints, self.way = names, np.zeros(0), 0.0
        self.states = self.node.create_publisher(JointState, JOINT_STATES.name, 10)
        self.node.create_timer(0.01, self._publish)

    def _publish(self) -> None:
        if not len(self.joints):
            return
        self.joints = self.joints + self.way
        message = JointState(name=self.names, position=self.joints.tolist())
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.states.publish(message)

    def until(self, condition: Callable[[], bool], seconds: float = 40.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, 'nothing comes of it'
            self.executor.spin_once(timeout_sec=0.02)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)


A = TypeVar('A', bound=PosedArm)


@contextmanager
def posed(kind: type[A], names: list[str]) -> Iterator[tuple[A, int]]:
    """Such an arm and its domain."""
    domain, context = held_domain(), rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    made = kind(context, names)
    yield made, domain
    made.executor.shutdown()
    made.node.destroy_node()
    rclpy.shutdown(context=context)
