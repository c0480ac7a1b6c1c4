# SPDX-License-Identifier: Apache-2.0
"""Run a package specific executable."""

import argparse
import os
import shlex
import signal
from typing import NoReturn

from ..command_line import Refusal
from ..nearest import nearest
from ..packages import executables

#: packages whose commands and nodes let in the signals that came while they were being loaded
OURS = {'calib_model', 'selfcenter_probe', 'calib_capture', 'calib_solver', 'calib_bringup'}
EXAMPLE = 'ros2 run calib_capture capture --ros-args -p output:=output/my_bag'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--prefix',
        help='Prefix command, which should go before the executable; '
        'in quotes where it contains spaces',
    )
    parser.add_argument('package_name', help='Name of the ROS package')
    parser.add_argument('executable_name', help='Name of the executable')
    parser.add_argument(
        'argv', nargs=argparse.REMAINDER, help='Pass arbitrary arguments to the executable'
    )


def main(args: argparse.Namespace) -> None:
    start(args.package_name, args.executable_name, args.argv, shlex.split(args.prefix or ''))


def start(package: str, name: str, argv: list[str], prefix: list[str]) -> NoReturn:
    """Become the executable, so that signals and the exit code need no passing on."""
    there = {path.name: path for path in executables(package)}
    if name not in there:
        raise Refusal(f'No executable found{nearest(name, there)}')
    path = there[name]
    command = [*prefix, str(path), *argv]
    if prefix or package not in OURS:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    try:
        os.execvp(command[0], command)
    except OSError as error:
        raise Refusal(f'{command[0]}: {error.strerror}') from None
