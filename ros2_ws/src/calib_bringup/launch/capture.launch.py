# SPDX-License-Identifier: Apache-2.0
"""Captures a measuring program into a bag, with a simulated arm and probe or real ones.

Ends when the program is done; with serve:=true it waits for goals until Ctrl-C.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from calib_bringup.launching import ARM, CAPTURE, RVIZ, SIMULATION, UNBUFFERED, chosen, parameters
from calib_bringup.showing import robot_description, rviz_layout

OF_ARM, OF_PROBE = ('arm', 'time_scale'), ('arm', 'probe', 'gauge', 'placements', 'world', 'seed')


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in (*CAPTURE, *SIMULATION, RVIZ)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    started = [
        Node(
            package='calib_capture',
            executable='capture',
            output='screen',
            parameters=[parameters(CAPTURE, given)],
            additional_env=UNBUFFERED,
            on_exit=Shutdown(),
        )
    ]
    if chosen('simulate', given):
        every = (*CAPTURE, *SIMULATION)
        for package, executable, names in (
            ('calib_capture', 'arm', OF_ARM),
            ('selfcenter_probe', 'probe', OF_PROBE),
        ):
            told = parameters([each for each in every if each.name in names], given)
            started.append(
                Node(package=package, executable=executable, parameters=[told], output='screen')
            )
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
