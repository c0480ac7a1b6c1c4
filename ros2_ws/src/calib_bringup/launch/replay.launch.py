# SPDX-License-Identifier: Apache-2.0
"""Plays a recorded bag back onto its topics; ends when it is played."""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from calib_bringup.launching import ARM, REPLAY, RVIZ, UNBUFFERED, chosen, options
from calib_bringup.showing import robot_description, rviz_layout


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in (*REPLAY, ARM, RVIZ)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    words = [given['bag'], *options([each for each in REPLAY if each.name != 'bag'], given)]
    started = [
        Node(
            package='calib_capture',
            executable='replay',
            output='screen',
            arguments=words,
            additional_env=UNBUFFERED,
            on_exit=Shutdown(),
        ),
    ]
    if chosen('rviz', given):
        described = [{'robot_description': robot_description(given[ARM.name])}]
        started += [
            Node(
                package='robot_state_publisher',
                executable='robot_state_publisher',
                parameters=described,
            ),
            Node(package='rviz2', executable='rviz2', arguments=['-d', rviz_layout()]),
        ]
    return started
