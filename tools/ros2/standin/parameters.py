# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node in another process."""

import argparse

from rclpy.node import Node
from rclpy.parameter_client import AsyncParameterClient

from .command_line import Refusal
from .graph import absolute, add_discovery_arguments, node_names, wait_until
from .nearest import nearest


def add_node_arguments(parser: argparse.ArgumentParser, nargs: str | None = None) -> None:
    add_discovery_arguments(parser)
    parser.add_argument('node_name', nargs=nargs, help='Name of the ROS node')
    parser.add_argument(
        '--timeout',
        metavar='N',
        type=float,
        default=3.0,
        help='Wait for N seconds until node becomes available (default %(default)s sec)',
    )


def parameters_of(node: Node, name: str, timeout: float) -> AsyncParameterClient:
    """Client of the node's parameter services.

    Raises:
        Refusal: there is no such node, or it has no such services.
    """
    name = absolute(name)
    if not wait_until(node, lambda: name in node_names(node), timeout):
        raise Refusal(f'Node not found{nearest(name, node_names(node))}')
    client = AsyncParameterClient(node, name)
    if not wait_until(node, client.services_are_ready, 5.0):
        raise Refusal(f'Wait for service timed out waiting for parameter services for node {name}')
    return client
