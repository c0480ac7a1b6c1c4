# SPDX-License-Identifier: Apache-2.0
"""Passes both streams on from /raw, one message in a hundred dropped, doubled or held back."""

import sys
from collections import Counter

import numpy as np
import rclpy
from calib_interfaces.msg import StylusDisplacements
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

from calib_model.nodes import lean_executor, qos_of
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS

SHARE = 0.01  # of each fault
done = Counter()


def relay(node: Node, kind: type, topic, rng: np.random.Generator) -> None:
    out = node.create_publisher(kind, topic.name, qos_of(topic))
    held = []

    def take(raw: bytes) -> None:
        chance = rng.random()
        if chance < SHARE:
            done[f'{topic.name} dropped'] += 1
            return
        if chance < 2 * SHARE and not held:
            done[f'{topic.name} out of order'] += 1
            held.append(raw)
            return
        out.publish(raw)
        if chance > 1 - SHARE:
            done[f'{topic.name} doubled'] += 1
            out.publish(raw)
        while held:
            out.publish(held.pop())

    node.create_subscription(
        kind, f'/raw{topic.name}', take, qos_of(topic, best_effort=True), raw=True
    )


def main() -> None:
    rclpy.init()
    node = Node('relay')
    rng = np.random.default_rng(int(sys.argv[1]))
    relay(node, JointState, JOINT_STATES, rng)
    relay(node, StylusDisplacements, PROBE_DISPLACEMENTS, rng)
    executor = lean_executor()
    executor.add_node(node)
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        print(dict(done), flush=True)


if __name__ == '__main__':
    main()
