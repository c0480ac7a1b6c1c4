# SPDX-License-Identifier: Apache-2.0
"""Output a list of available services."""

import argparse

from ...graph import add_discovery_arguments, graph_node, print_names, visible

EXAMPLE = 'ros2 service list -t'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument(
        '-t', '--show-types', action='store_true', help='Additionally show the service type'
    )
    parser.add_argument(
        '-c',
        '--count-services',
        action='store_true',
        help='Only display the number of services discovered',
    )
    parser.add_argument(
        '--include-hidden-services', action='store_true', help='Consider hidden services as well'
    )


def main(args: argparse.Namespace) -> None:
    with graph_node(spin_time=args.spin_time) as node:
        services = visible(node.get_service_names_and_types(), args.include_hidden_services)
    print_names(services, args.show_types, args.count_services)
