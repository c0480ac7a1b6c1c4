# SPDX-License-Identifier: Apache-2.0
"""Get parameter."""

import argparse

from rcl_interfaces.msg import ParameterType
from rclpy.parameter import parameter_value_to_python

from ...command_line import Refusal
from ...graph import answer, graph_node
from ...nearest import nearest
from ...parameters import add_node_arguments, parameters_of

LABELS = {
    ParameterType.PARAMETER_BOOL: 'Boolean value is:',
    ParameterType.PARAMETER_INTEGER: 'Integer value is:',
    ParameterType.PARAMETER_DOUBLE: 'Double value is:',
    ParameterType.PARAMETER_STRING: 'String value is:',
    ParameterType.PARAMETER_BYTE_ARRAY: 'Byte values are:',
    ParameterType.PARAMETER_BOOL_ARRAY: 'Boolean values are:',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'Integer values are:',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'Double values are:',
    ParameterType.PARAMETER_STRING_ARRAY: 'String values are:',
}

EXAMPLE = 'ros2 param get /arm time_scale'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_node_arguments(parser)
    parser.add_argument('parameter_name', help='Name of the parameter')
    parser.add_argument('--hide-type', action='store_true', help='Hide the type information')


def main(args: argparse.Namespace) -> None:
    with graph_node('param') as node:
        client = parameters_of(node, args.node_name, args.timeout)
        values = answer(node, client.get_parameters([args.parameter_name])).values
        if not values or values[0].type not in LABELS:
            known = answer(node, client.list_parameters()).result.names
            raise Refusal(f'Parameter not set{nearest(args.parameter_name, known)}')
    value = parameter_value_to_python(values[0])
    shown = value.tolist() if hasattr(value, 'tolist') else value
    print(shown if args.hide_type else f'{LABELS[values[0].type]} {shown}')
