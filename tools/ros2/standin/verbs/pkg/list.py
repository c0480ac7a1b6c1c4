# SPDX-License-Identifier: Apache-2.0
"""Output a list of available packages."""

import argparse

from ament_index_python.packages import get_packages_with_prefixes

EXAMPLE = 'ros2 pkg list'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """It has none."""


def main(args: argparse.Namespace) -> None:
    print(*sorted(get_packages_with_prefixes()), sep='\n')
