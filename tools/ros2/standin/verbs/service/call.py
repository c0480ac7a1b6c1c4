# SPDX-License-Identifier: Apache-2.0
"""Call a service."""

import argparse
import sys
import time
from typing import Any

from ...command_line import Refusal
from ...fields import fill, parse
from ...graph import answer, graph_node, wait_for_server, wait_until
from ...interfaces import full_name, interface

EXAMPLE = (
    'ros2 service call /identify calib_interfaces/srv/Identify '
    '"{bag: \'bags/demo/identification\'}"'
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'service_name', help="Name of the ROS service to call to (e.g. '/identify')"
    )
    parser.add_argument('service_type', help="Type of the ROS service (e.g. 'std_srvs/srv/Empty')")
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        'values',
        nargs='?',
        default='{}',
        help="Values to fill the service request with in YAML format (e.g. '{a: 1, b: 2}')",
    )
    group.add_argument('--stdin', action='store_true', help='Read values from standard input')
    parser.add_argument(
        '-r', '--rate', metavar='N', type=float, help='Repeat the call at a specific rate in Hz'
    )


def main(args: argparse.Namespace) -> None:
    if args.rate is not None and args.rate <= 0:
        raise Refusal('rate must be greater than zero')
    service = interface(args.service_type, 'srv')
    request = service.Request()
    fill(request, parse(sys.stdin.read() if args.stdin else args.values))
    with graph_node('requester') as node:
        client = node.create_client(service, args.service_name)
        if not client.service_is_ready():
            print('waiting for service to become available...')
            wait_for_server(
                node,
                client.service_is_ready,
                args.service_name,
                'service',
                full_name(args.service_type, 'srv'),
                node.get_service_names_and_types,
            )
        while True:
            start = time.monotonic()
            call(node, client, request)
            if args.rate is None:
                break
            wait_until(node, lambda: False, start + 1 / args.rate - time.monotonic())


def call(node: Any, client: Any, request: Any) -> None:
    print(f'requester: making request: {request!r}\n')
    print(f'response:\n{answer(node, client.call_async(request))!r}\n')
