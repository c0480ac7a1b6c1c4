# SPDX-License-Identifier: Apache-2.0
"""Print the average publishing rate to screen."""

import argparse
import math
import statistics
import time
from collections import deque
from typing import Any

from rclpy.qos import qos_profile_sensor_data

from ...graph import absolute, add_discovery_arguments, graph_node, wait_until
from ...subscribing import topic_type

EXAMPLE = 'ros2 topic hz /joint_states'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument('topic_name', help="Name of the ROS topic to listen to (e.g. '/chatter')")
    parser.add_argument(
        '--window',
        '-w',
        type=int,
        default=10000,
        metavar='WINDOW',
        help='window size, in # of messages (default: %(default)d)',
    )


def main(args: argparse.Namespace) -> None:
    topic = absolute(args.topic_name)
    arrivals: deque[float] = deque(maxlen=max(args.window, 1) + 1)

    def note(message: bytes) -> None:
        arrivals.append(time.monotonic())

    with graph_node('hz') as node:
        wait_until(node, lambda: bool(node.get_publishers_info_by_topic(topic)), math.inf)
        kind: Any = topic_type(node, topic, None)
        # Raw, because nothing but the time of arrival is looked at.
        node.create_subscription(kind, topic, note, qos_profile_sensor_data, raw=True)
        printed = 0.0
        while True:
            wait_until(node, lambda: False, 1.0)
            if len(arrivals) > 1 and arrivals[-1] > printed:
                printed = arrivals[-1]
                print(summary(list(arrivals)))


def summary(arrivals: list[float]) -> str:
    """The two lines of ros2cli for two or more times of arrival in seconds."""
    gaps = [later - sooner for sooner, later in zip(arrivals, arrivals[1:], strict=False)]
    mean = statistics.fmean(gaps)
    rate = 1 / mean if mean > 0 else 0.0
    return (
        f'average rate: {rate:.3f}\n\tmin: {min(gaps):.3f}s max: {max(gaps):.3f}s '
        f'std dev: {statistics.pstdev(gaps):.5f}s window: {len(gaps)}'
    )
