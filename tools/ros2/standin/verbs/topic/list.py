# SPDX-License-Identifier: Apache-2.0
"""Output a list of available topics."""

import argparse

from ...graph import add_discovery_arguments, graph_node, print_names, visible

EXAMPLE = 'ros2 topic list -t'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_discovery_arguments(parser)
    parser.add_argument(
        '-t', '--show-types', action='store_true', help='Additionally show the topic type'
    )
    parser.add_argument(
        '-c',
        '--count-topics',
        action='store_true',
        help='Only display the number of topics discovered',
    )
    parser.add_argument(
        '--include-hidden-topics', action='store_true', help='Consider hidden topics as well'
    )
    parser.add_argument(
        '-v', '--verbose', action='store_true', help='List full details about each topic'
    )


def main(args: argparse.Namespace) -> None:
    with graph_node(spin_time=args.spin_time) as node:
        topics = visible(node.get_topic_names_and_types(), args.include_hidden_topics)
        publishers = {name: node.count_publishers(name) for name, _ in topics}
        subscribers = {name: node.count_subscribers(name) for name, _ in topics}
    if args.verbose and not args.count_topics:
        print(details('Published', 'publisher', topics, publishers))
        print(details('Subscribed', 'subscriber', topics, subscribers))
    else:
        print_names(topics, args.show_types, args.count_topics)


def details(
    title: str, noun: str, topics: list[tuple[str, list[str]]], counts: dict[str, int]
) -> str:
    lines = [f'{title} topics:']
    for name, types in topics:
        if count := counts[name]:
            lines.append(f' * {name} [{", ".join(types)}] {count} {noun}{"s" * (count > 1)}')
    return '\n'.join(lines) + '\n'
