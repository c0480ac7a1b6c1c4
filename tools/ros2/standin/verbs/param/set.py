# SPDX-License-Identifier: Apache-2.0
"""Set parameter."""

import argparse

from rcl_interfaces.msg import Parameter
from rclpy.parameter import get_parameter_value

from ...command_line import Refusal
from ...graph import answer, graph_node
from ...parameters import add_node_arguments, parameters_of

EXAMPLE = 'ros2 param set /arm time_scale 5.0'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_node_arguments(parser)
    parser.add_argument('parameter_name', help='Name of the parameter')
    parser.add_argument('value', help='Value of the parameter')


def main(args: argparse.Namespace) -> None:
    parameter = Parameter(name=args.parameter_name, value=get_parameter_value(args.value))
    with graph_node('param') as node:
        client = parameters_of(node, args.node_name, args.timeout)
        result = answer(node, client.set_parameters([parameter])).results[0]
    reason = f': {result.reason}' if result.reason else ''
    if not result.successful:
        raise Refusal(f'Setting parameter failed{reason}')
    print(f'Set parameter successful{reason}')
