# SPDX-License-Identifier: Apache-2.0
"""Output a list of package specific executables."""

import argparse

from ament_index_python.packages import get_packages_with_prefixes

from ...packages import executables

EXAMPLE = 'ros2 pkg executables calib_solver'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('package_name', nargs='?', help='The package name')
    parser.add_argument(
        '--full-path', action='store_true', help='Show full path of each executable'
    )


def main(args: argparse.Namespace) -> None:
    named = [args.package_name] if args.package_name else sorted(get_packages_with_prefixes())
    for package in named:
        for path in executables(package):
            print(path if args.full_path else f'{package} {path.name}')
