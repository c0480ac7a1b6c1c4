# SPDX-License-Identifier: Apache-2.0
"""The solver: answers /identify, /fit_probe and /evaluate until Ctrl-C."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch_ros.actions import Node

from calib_bringup.launching import NAMESPACE, PARAMETERS, SOLVER, told


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in (*SOLVER, NAMESPACE, PARAMETERS)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    return [
        Node(
            package='calib_solver',
            executable='solver',
            output='screen',
            parameters=told(SOLVER, given),
            namespace=given[NAMESPACE.name],
        )
    ]
