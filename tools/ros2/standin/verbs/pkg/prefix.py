# SPDX-License-Identifier: Apache-2.0
"""Output the prefix path of a package."""

import argparse

from ...packages import package_prefix

EXAMPLE = 'ros2 pkg prefix calib_bringup --share'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument('package_name', help='The package name')
    parser.add_argument('--share', action='store_true', help='Show share directory for the package')


def main(args: argparse.Namespace) -> None:
    prefix = package_prefix(args.package_name)
    print(prefix / 'share' / args.package_name if args.share else prefix)
