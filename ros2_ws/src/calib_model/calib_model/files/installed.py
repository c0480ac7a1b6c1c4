# SPDX-License-Identifier: Apache-2.0
"""Where a package's configuration lies: under share/ of a workspace, in the package of a wheel."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def shared_file(package: str, file: str) -> Path | None:
    """The path of a file that a package brings, such as `config/arms/ur5.yaml`; None where the
    package is not installed."""
    folder = _share(package) or _code(package)
    return folder / file if folder else None


def _share(package: str) -> Path | None:
    try:
        from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
    except ModuleNotFoundError:  # without ROS
        return None
    try:
        return Path(get_package_share_directory(package))
    except (PackageNotFoundError, OSError):  # OSError: no workspace is sourced
        return None


def _code(package: str) -> Path | None:
    spec = find_spec(package)
    folders = [Path(each) for each in (spec and spec.submodule_search_locations) or ()]
    return next((each for each in folders if (each / 'config').is_dir()), None)
