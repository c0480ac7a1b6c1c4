# SPDX-License-Identifier: Apache-2.0
"""Output a service's type."""

import argparse

from ...graph import PATIENCE, absolute, add_discovery_arguments, graph_node, wait_for

EXAMPLE = 'ros2 service type /identify'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument(
        'service_name', help="Name of the ROS service to get type (e.g. '/identify')"
    )


def main(args: argparse.Namespace) -> int:
    with graph_node() as node:

        def types() -> list[str]:
            return dict(node.get_service_names_and_types()).get(absolute(args.service_name), [])

        found = wait_for(node, types, args.spin_time + PATIENCE)
        for name in types():
            print(name)
    return 0 if found else 1
