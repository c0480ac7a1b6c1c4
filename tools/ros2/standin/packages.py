# SPDX-License-Identifier: Apache-2.0
"""Installed packages and what they bring, from the ament index."""

import os
from pathlib import Path

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_packages_with_prefixes,
)

from .command_line import Refusal
from .nearest import nearest


def package_prefix(package: str) -> Path:
    """Folder the package is installed under.

    Raises:
        Refusal: it is not installed.
    """
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        there = nearest(package, get_packages_with_prefixes())
        raise Refusal(f"Package '{package}' not found{there}") from None


def executables(package: str) -> list[Path]:
    """What `ros2 run` can start."""
    folder = package_prefix(package) / 'lib' / package
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_file() and os.access(path, os.X_OK))
