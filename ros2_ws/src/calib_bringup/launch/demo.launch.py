# SPDX-License-Identifier: Apache-2.0
"""A whole calibration in simulation, from capture to report; ends when it is done."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch_ros.substitutions import ExecutableInPackage

from calib_bringup.launching import DEMO, UNBUFFERED, options


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in DEMO
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[ExecuteProcess]:
    # A command, no node: it takes no --ros-args, and starts its nodes on a graph of their own.
    demo = ExecutableInPackage(package='calib_bringup', executable='demo')
    return [
        ExecuteProcess(
            cmd=[demo, *options(DEMO, context.launch_configurations)],
            name='demo',
            output='screen',
            additional_env=UNBUFFERED,
            on_exit=Shutdown(),
        )
    ]
