# SPDX-License-Identifier: Apache-2.0
"""Output a list of available nodes."""

import argparse
import sys

from ...graph import add_discovery_arguments, graph_node, node_names

EXAMPLE = 'ros2 node list'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument(
        '-a', '--all', action='store_true', help='Display all nodes even hidden ones'
    )
    parser.add_argument(
        '-c',
        '--count-nodes',
        action='store_true',
        help='Only display the number of nodes discovered',
    )


def main(args: argparse.Namespace) -> None:
    with graph_node(spin_time=args.spin_time) as node:
        names = node_names(node, args.all)
    if args.count_nodes:
        print(len(names))
        return
    if len(set(names)) < len(names):
        print(
            'WARNING: Be aware that there are nodes in the graph that share an exact name, '
            'which can have unintended side effects.',
            file=sys.stderr,
        )
    for name in names:
        print(name)
