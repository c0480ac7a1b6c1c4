# SPDX-License-Identifier: Apache-2.0
"""Run a package specific executable."""

import argparse
import os
import shlex
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from ..command_line import Refusal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('--prefix', help='Prefix command, which should go before the executable; '
                        'in quotes where it contains spaces')
    parser.add_argument('package_name', help='Name of the ROS package')
    parser.add_argument('executable_name', help='Name of the executable')
    parser.add_argument('argv', nargs=argparse.REMAINDER,
                        help='Pass arbitrary arguments to the executable')


def main(args: argparse.Namespace) -> None:
    try:
        prefix = get_package_prefix(args.package_name)
    except (PackageNotFoundError, ValueError):
        raise Refusal(f"Package '{args.package_name}' not found") from None
    path = Path(prefix, 'lib', args.package_name, args.executable_name)
    if not path.is_file() or not os.access(path, os.X_OK):
        raise Refusal('No executable found')
    command = [*shlex.split(args.prefix or ''), str(path), *args.argv]
    # In place of this process, so that signals and the exit code need no passing on.
    try:
        os.execvp(command[0], command)
    except OSError as error:
        raise Refusal(f'{command[0]}: {error.strerror}') from None
