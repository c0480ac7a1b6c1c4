# SPDX-License-Identifier: Apache-2.0
"""Output messages from a topic."""

import argparse
import math
from typing import Any

from rclpy.task import Future

from ...command_line import Refusal
from ...fields import TRUNCATE_LENGTH, as_yaml
from ...graph import PATIENCE, absolute, add_discovery_arguments, graph_node, wait_for, wait_until
from ...subscribing import add_qos_arguments, chosen_qos, topic_type

EXAMPLE = 'ros2 topic echo /probe/displacements --once'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument('topic_name', help="Name of the ROS topic to listen to (e.g. '/chatter')")
    parser.add_argument(
        'message_type', nargs='?', help="Type of the ROS message (e.g. 'std_msgs/msg/String')"
    )
    add_qos_arguments(parser)
    parser.add_argument(
        '--field',
        help="Echo a selected field of a message; '.' selects sub-fields (e.g. header.stamp)",
    )
    parser.add_argument(
        '--full-length',
        '-f',
        action='store_true',
        help='Output all elements of long arrays, bytes and strings',
    )
    parser.add_argument(
        '--truncate-length',
        '-l',
        type=int,
        default=TRUNCATE_LENGTH,
        help='The length to truncate to (default: %(default)d)',
    )
    parser.add_argument(
        '--flow-style', action='store_true', help='Print collections in the flow style'
    )
    parser.add_argument(
        '--once', action='store_true', help='Print the first message received and then exit.'
    )
    parser.add_argument(
        '--timeout', metavar='N', type=float, help='Set a timeout in seconds for waiting'
    )


def main(args: argparse.Namespace) -> None:
    topic = absolute(args.topic_name)
    truncate = None if args.full_length else args.truncate_length
    finished = Future()

    def show(message: Any) -> None:
        if finished.done():
            return
        try:
            print(shown(message, args.field, truncate, args.flow_style), end='---\n')
        except Refusal as refusal:
            finished.set_exception(refusal)
        else:
            if args.once:
                finished.set_result(None)

    with graph_node('echo') as node:
        # With the type given, publishers may come later; without it there must be one.
        patience = args.spin_time + (0.0 if args.message_type else PATIENCE)
        wait_for(node, lambda: node.get_publishers_info_by_topic(topic), patience)
        kind = topic_type(node, topic, args.message_type)
        node.create_subscription(kind, topic, show, chosen_qos(node, topic, args))
        if wait_until(node, finished.done, args.timeout or math.inf):
            finished.result()


def shown(message: Any, field: str | None, truncate: int | None, flow: bool) -> str:
    """What is printed of a message: YAML, or the plain value of a field that is no message."""
    value = message
    for name in (field or '').split('.'):
        if not name:
            continue
        if not hasattr(value, name):
            raise Refusal(
                f"Invalid field '{field}': '{type(value).__name__}' object has no "
                f"attribute '{name}'"
            )
        value = getattr(value, name)
    if hasattr(value, 'get_fields_and_field_types'):
        return as_yaml(value, truncate, flow)
    return f'{value}\n'
