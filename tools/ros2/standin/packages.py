# SPDX-License-Identifier: Apache-2.0
"""Installed packages and what they bring, from the ament index."""

import os
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix

from .command_line import Refusal


def package_prefix(package: str) -> Path:
    """Folder the package is installed under.

    Raises:
        Refusal: it is not installed.
    """
    try:
        return Path(get_package_prefix(package))
    except (PackageNotFoundError, ValueError):
        raise Refusal(f"Package '{package}' not found") from None


def executables(package: str) -> list[Path]:
    """What `ros2 run` can start."""
    folder = package_prefix(package) / 'lib' / package
    if not folder.is_dir():
        return []
    return sorted(path for path in folder.iterdir() if path.is_file() and os.access(path, os.X_OK))
