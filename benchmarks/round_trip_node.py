# SPDX-License-Identifier: Apache-2.0
"""A message there and back between two processes, one after the other: `echo`, `ask COUNT`."""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

from calib_model.nodes import lean_executor

WARM = 200


def echo(node: Node) -> None:
    """Send everything back, until ended."""
    back = node.create_publisher(JointState, 'back', 10)
    node.create_subscription(JointState, 'there', back.publish, 10, raw=True)
    executor = lean_executor()
    executor.add_node(node)
    while rclpy.ok():
        executor.spin_once(timeout_sec=0.1)


def ask(node: Node, count: int) -> float:
    """Seconds per round trip."""
    came: list[bytes] = []
    there = node.create_publisher(JointState, 'there', 10)
    node.create_subscription(JointState, 'back', came.append, 10, raw=True)
    executor = lean_executor()
    executor.add_node(node)
    while not (there.get_subscription_count() and node.count_publishers('back')):
        executor.spin_once(timeout_sec=0.05)
    time.sleep(0.5)
    message = JointState(name=[f'joint_{i}' for i in range(6)], position=[0.0] * 6)
    begun = 0.0
    for number in range(count + WARM):
        if number == WARM:
            begun = time.perf_counter()
        there.publish(message)
        while len(came) <= number:
            executor.spin_once(timeout_sec=0.1)
    return (time.perf_counter() - begun) / count


def main() -> None:
    """The command."""
    rclpy.init()
    node = rclpy.create_node(f'round_trip_{sys.argv[1]}')
    if sys.argv[1] == 'echo':
        echo(node)
    else:
        print(ask(node, int(sys.argv[2])))
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
