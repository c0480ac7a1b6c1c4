# SPDX-License-Identifier: Apache-2.0
"""Output a list of available parameters."""

import argparse

from ...graph import answer, graph_node, node_names, wait_until
from ...parameters import add_node_arguments, parameters_of

EXAMPLE = 'ros2 param list /capture'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_node_arguments(parser, nargs='?')


def main(args: argparse.Namespace) -> None:
    with graph_node('param') as node:
        if args.node_name is None:
            wait_until(node, lambda: False, args.spin_time)
        for name in [args.node_name] if args.node_name else node_names(node):
            client = parameters_of(node, name, args.timeout)
            names = answer(node, client.list_parameters()).result.names
            if not args.node_name and names:
                print(f'{name}:')
            for parameter in sorted(names):
                print(f'  {parameter}')
