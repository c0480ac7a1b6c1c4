# SPDX-License-Identifier: Apache-2.0
"""The solver: answers /identify, /fit_probe and /evaluate until Ctrl-C."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from calib_bringup.launching import SOLVER, parameters


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in SOLVER
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    told = parameters(SOLVER, context.launch_configurations)
    return [Node(package='calib_solver', executable='solver', output='screen', parameters=[told])]
