# SPDX-License-Identifier: Apache-2.0
"""Captures a measuring program into a bag, with a simulated arm and probe or real ones.

Ends when the program is done; with serve:=true it waits for goals until Ctrl-C.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from calib_bringup.launching import (
    ARM,
    CAPTURE,
    NAMESPACE,
    PARAMETERS,
    REMAPPED,
    RVIZ,
    SIMULATION,
    UNBUFFERED,
    chosen,
    remappings,
    told,
)
from calib_bringup.showing import robot_description, rviz_layout

OF_ARM = ('arm', 'controller', 'time_scale')
OF_PROBE = ('arm', 'probe', 'gauge', 'placements', 'world', 'seed')


def generate_launch_description() -> LaunchDescription:
    declared = [
        DeclareLaunchArgument(each.name, default_value=each.default, description=each.about)
        for each in (*CAPTURE, *SIMULATION, NAMESPACE, PARAMETERS, *REMAPPED, RVIZ)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])


def nodes(context: LaunchContext) -> list[Node]:
    given = context.launch_configurations
    shared = {'namespace': given[NAMESPACE.name], 'remappings': remappings(given)}
    started = [
        Node(
            package='calib_capture',
            executable='capture',
            output='screen',
            parameters=told(CAPTURE, given),
            additional_env=UNBUFFERED,
            on_exit=Shutdown(),
            **shared,
        )
    ]
    if chosen('simulate', given):
        every = (*CAPTURE, *SIMULATION)
        for package, executable, names in (
            ('calib_capture', 'sim_arm', OF_ARM),
            ('selfcenter_probe', 'sim_probe', OF_PROBE),
        ):
            known = told([each for each in every if each.name in names], given)
            started.append(
                Node(
                    package=package,
                    executable=executable,
                    parameters=known,
                    output='screen',
                    **shared,
                )
            )
    if chosen('rviz', given):
        described = [{'robot_description': robot_description(given[ARM.name])}]
        started += [
            Node(
                package='robot_state_publisher',
                executable='robot_state_publisher',
                parameters=described,
                **shared,
            ),
            Node(package='rviz2', executable='rviz2', arguments=['-d', rviz_layout()]),
        ]
    return started
