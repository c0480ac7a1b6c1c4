# SPDX-License-Identifier: Apache-2.0
"""Output a list of action names."""

import argparse

from rclpy.action import get_action_names_and_types

from ...graph import add_discovery_arguments, graph_node, print_names

EXAMPLE = 'ros2 action list -t'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument(
        '-t', '--show-types', action='store_true', help='Additionally show the action type'
    )
    parser.add_argument(
        '-c',
        '--count-actions',
        action='store_true',
        help='Only display the number of actions discovered',
    )


def main(args: argparse.Namespace) -> None:
    with graph_node(spin_time=args.spin_time) as node:
        actions = get_action_names_and_types(node)
    print_names(actions, args.show_types, args.count_actions)
