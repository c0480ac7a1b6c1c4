# SPDX-License-Identifier: Apache-2.0
"""Send an action goal."""

import argparse
import sys
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient, get_action_names_and_types
from rclpy.node import Node

from ...command_line import Interrupted, Refusal
from ...fields import as_yaml, fill, parse
from ...graph import answer, graph_node, wait_for_server
from ...interfaces import full_name, interface

STATES = ('ACCEPTED', 'EXECUTING', 'CANCELING', 'SUCCEEDED', 'CANCELED', 'ABORTED')
STATE_NAMES = {getattr(GoalStatus, f'STATUS_{name}'): name for name in STATES}

EXAMPLE = (
    'ros2 action send_goal --feedback /capture/run calib_interfaces/action/Capture '
    '"{locations: [1]}"'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('action_name', help="Name of the ROS action (e.g. '/capture/run')")
    parser.add_argument(
        'action_type', help="Type of the ROS action (e.g. 'calib_interfaces/action/Capture')"
    )
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        'goal',
        nargs='?',
        default='{}',
        help="Goal request values in YAML format (e.g. '{bag: here}')",
    )
    group.add_argument('--stdin', action='store_true', help='Read goal from standard input')
    parser.add_argument(
        '-f', '--feedback', action='store_true', help='Echo feedback messages for the goal'
    )


def main(args: argparse.Namespace) -> None:
    action = interface(args.action_type, 'action')
    goal = action.Goal()
    fill(goal, parse(sys.stdin.read() if args.stdin else args.goal))
    with graph_node('send_goal') as node:
        client = ActionClient(node, action, args.action_name)
        try:
            print('Waiting for an action server to become available...')
            wait_for_server(
                node,
                client.server_is_ready,
                args.action_name,
                'action',
                full_name(args.action_type, 'action'),
                lambda: get_action_names_and_types(node),
            )
            send(node, client, goal, show_feedback if args.feedback else None)
        finally:
            client.destroy()


def send(node: Node, client: ActionClient, goal: Any, feedback: Any) -> None:
    print(f'Sending goal:\n     {as_yaml(goal)}')
    sent = client.send_goal_async(goal, feedback)
    try:
        handle = answer(node, sent)
        if not handle.accepted:
            print('Goal was rejected.')
            return
        print(f'Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n')
        result = answer(node, handle.get_result_async())
    except Interrupted:
        cancel(node, answer(node, sent))
        raise
    print(f'Result:\n    {as_yaml(result.result)}')
    print(f'Goal finished with status: {STATE_NAMES.get(result.status, "UNKNOWN")}')


def cancel(node: Node, handle: Any) -> None:
    if not handle.accepted:
        return
    print('Canceling goal...')
    if not answer(node, handle.cancel_goal_async()).goals_canceling:
        raise Refusal('Failed to cancel goal')
    print('Goal canceled.')


def show_feedback(message: Any) -> None:
    print(f'Feedback:\n    {as_yaml(message.feedback)}')
