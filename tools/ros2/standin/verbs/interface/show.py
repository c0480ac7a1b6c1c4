# SPDX-License-Identifier: Apache-2.0
"""Output the interface definition."""

import argparse
import re
from pathlib import Path

from ...command_line import Refusal
from ...interfaces import installed
from ...nearest import nearest
from ...packages import package_prefix

FIELD = re.compile(r'(?P<type>[A-Za-z][\w/]*)(\[[^\]]*\])?\s+\w+\s*(?!.*=)')

EXAMPLE = 'ros2 interface show calib_interfaces/srv/Identify'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        'type', help="Show an interface definition (e.g. 'calib_interfaces/msg/ProbingPose')"
    )
    parser.add_argument(
        '--all-comments',
        action='store_true',
        help='Show all comments, those of nested messages too',
    )
    parser.add_argument('--no-comments', action='store_true', help='Show no comments or whitespace')


def main(args: argparse.Namespace) -> None:
    parts = args.type.split('/')
    if len(parts) != 3 or parts[1] not in ('msg', 'srv', 'action'):
        raise Refusal(f"Invalid name '{args.type}'. Expected three parts separated by '/'")
    show(definition(*parts), parts[0], '', not args.no_comments, args.all_comments)


def definition(package: str, kind: str, name: str) -> str:
    path = Path(package_prefix(package), 'share', package, kind, f'{name}.{kind}')
    if not path.is_file():
        there = nearest(f'{package}/{kind}/{name}', installed(package, kind))
        raise Refusal(f"Could not find the interface '{path}'{there}")
    return path.read_text()


def show(text: str, package: str, indent: str, comments: bool, nested_comments: bool) -> None:
    """Print a definition, the messages it contains one tab further in below their field."""
    for line in text.splitlines():
        bare = line.split('#')[0].rstrip()
        if comments or bare:
            print(indent + (line if comments else bare))
        nested = nested_message(bare, package)
        if nested is not None:
            show(
                definition(*nested),
                nested[0],
                f'{indent}\t',
                comments and nested_comments,
                nested_comments,
            )


def nested_message(line: str, package: str) -> tuple[str, str, str] | None:
    """Package, kind and name of the message that a line without comment is a field of."""
    field = FIELD.match(line)
    if field is None:
        return None
    kind = field['type']
    if '/' in kind:
        return kind.split('/')[0], 'msg', kind.split('/')[-1]
    return (package, 'msg', kind) if kind[0].isupper() else None  # built-in types are lower case
