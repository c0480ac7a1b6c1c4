# SPDX-License-Identifier: Apache-2.0
"""A whole calibration in simulation, from capture to report; ends when it is done."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from calib_bringup.launching import DEMO, UNBUFFERED, options


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in DEMO
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    return [
        Node(
            package='calib_bringup', executable='demo', output='screen', additional_env=UNBUFFERED,
            arguments=options(DEMO, context.launch_configurations), on_exit=Shutdown(),
        )
    ]  # fmt: skip
