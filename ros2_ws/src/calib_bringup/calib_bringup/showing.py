# SPDX-License-Identifier: Apache-2.0
"""What a viewer of the graph needs: the robot's description and the layout of the view."""

from __future__ import annotations

from pathlib import Path

from ament_index_python.packages import get_package_share_directory

from calib_model.descriptions import parse_arm, read_description
from calib_model.urdf import arm_urdf

DEFAULT_ARM = 'config/arms/kuka_kr5_sixx_r650.yaml'
RVIZ_LAYOUT = 'rviz/calibration.rviz'


def robot_description(arm: str = '') -> str:
    """The URDF of the arm whose YAML is at path `arm`; empty: the KUKA KR 5 sixx R650.

    Raises:
        DescriptionError: the file cannot be read or used.
    """
    return arm_urdf(read_description(arm or _shared(DEFAULT_ARM), parse_arm))


def rviz_layout() -> str:
    """The path of the layout for RViz."""
    return str(_shared(RVIZ_LAYOUT))


def _shared(file: str) -> Path:
    return Path(get_package_share_directory('calib_bringup')) / file
