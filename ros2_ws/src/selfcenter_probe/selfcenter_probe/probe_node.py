# SPDX-License-Identifier: Apache-2.0
"""The simulated self-centering probe as a node: `ros2 run selfcenter_probe probe`."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from calib_interfaces.msg import StylusDisplacements
from rcl_interfaces.msg import IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_model.command import run_command
from calib_model.description import (
    gauge_yaml,
    parse_arm,
    parse_gauge,
    parse_probe,
    probe_yaml,
    read_description,
)
from calib_model.errors import ParameterError
from calib_model.placement import parse_placements
from calib_model.run_node import run_node
from calib_model.topics import (
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
    Topic,
)
from selfcenter_probe.magnitudes import parse_magnitudes
from selfcenter_probe.messages import displacements, joints_of, qos_of, stamp_of
from selfcenter_probe.simulation import ProbeSimulation
from selfcenter_probe.world import World

T = TypeVar('T')
#: parameter: the package and file it defaults to, and what it is
FILES = {
    'arm': ('calib_bringup', 'config/arms/kuka_kr5_sixx_r650.yaml', 'arm description, nominal'),
    'probe': ('calib_bringup', 'config/probes/active_trihedron.yaml', 'probe description, nominal'),
    'gauge': ('calib_bringup', 'config/gauges/ball_bar_kr5.yaml', 'gauge description: certificate'),
    'placements': ('calib_bringup', 'config/locations/kr5.yaml', 'where the gauge should stand'),
    'world': ('selfcenter_probe', 'config/world.yaml', 'how far the truth is from all of these'),
}
COMPLAINT_PERIOD = 5.0  # s


class ProbeNode(Node):
    """Reads the world wherever the joint states take the arm, and publishes what the styli say.

    What it publishes as descriptions is what everyone is told, never how it really is.
    """

    def __init__(self) -> None:
        super().__init__('probe')
        arm = self._described('arm', parse_arm)
        probe = self._described('probe', parse_probe)
        gauge = self._described('gauge', parse_gauge)
        placements = self._described('placements', parse_placements)
        magnitudes = self._described('world', parse_magnitudes)
        seed = self._seed()
        generator = np.random.default_rng(magnitudes.seed if seed < 0 else seed)
        of_world, of_readings = generator.spawn(2)
        world = World.drawn(arm, probe, gauge, placements, magnitudes, of_world)
        self._simulation = ProbeSimulation(
            world,
            of_readings,
            self._number('rate', 100.0, (1.0, 1e4), 'Hz, readings per second of the stamps'),
            self._number('max_gap', 0.1, (1e-6, 10.0), 's, longest gap to interpolate joints over'),
        )
        self._frame = probe.name
        self._joint_names = arm.joint_names
        self._latched = [
            self._latch(PROBE_DESCRIPTION, probe_yaml(probe)),
            self._latch(GAUGE_DESCRIPTION, gauge_yaml(gauge)),
        ]
        self._readings = self.create_publisher(
            StylusDisplacements, PROBE_DISPLACEMENTS.name, qos_of(PROBE_DISPLACEMENTS)
        )
        self.create_subscription(
            JointState, JOINT_STATES.name, self._on_joints, qos_of(JOINT_STATES, best_effort=True)
        )
        self.get_logger().info(
            f'{probe.name} on {arm.name}, {gauge.name} at {len(placements)} locations'
        )

    def _described(self, name: str, parse: Callable[[str, str], T]) -> T:
        """What the file of parameter `name` says."""
        package, file, description = FILES[name]
        descriptor = ParameterDescriptor(
            description=f'path of a YAML file: {description}; empty: {file} of {package}',
            read_only=True,
        )
        given = self.declare_parameter(name, '', descriptor).value
        if given:
            return read_description(given, parse)
        try:
            return read_description(Path(get_package_share_directory(package)) / file, parse)
        except PackageNotFoundError as error:
            raise ParameterError(
                f"parameter '{name}' is empty and {package} is not installed: give a path"
            ) from error

    def _seed(self) -> int:
        descriptor = ParameterDescriptor(
            description='of the world and its noise; -1: the one in the world file',
            integer_range=[IntegerRange(from_value=-1, to_value=2**63 - 1, step=0)],
            read_only=True,
        )
        return int(self.declare_parameter('seed', -1, descriptor).value)

    def _number(
        self, name: str, default: float, bounds: tuple[float, float], description: str
    ) -> float:
        """A number within bounds; `rate:=200` is one, though ROS tells it from 200.0."""
        descriptor = ParameterDescriptor(
            description=f'{description}, from {bounds[0]:g} to {bounds[1]:g}',
            dynamic_typing=True,
            read_only=True,
        )
        value = self.declare_parameter(name, default, descriptor).value
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not bounds[0] <= value <= bounds[1]:
            raise ParameterError(
                f"parameter '{name}': expected a number from {bounds[0]:g} to {bounds[1]:g}, "
                f'got {value!r}'
            )
        return float(value)

    def _latch(self, topic: Topic, text: str) -> Publisher:
        publisher = self.create_publisher(String, topic.name, qos_of(topic))
        publisher.publish(String(data=text))
        return publisher

    def _on_joints(self, state: JointState) -> None:
        joints = joints_of(state, self._joint_names)
        if joints is None:
            self.get_logger().warning(
                f'joint states without {", ".join(self._joint_names)} are ignored',
                throttle_duration_sec=COMPLAINT_PERIOD,
            )
            return
        readings = self._simulation.advance([stamp_of(state)], joints)
        for message in displacements(readings, self._frame):
            self._readings.publish(message)


def main() -> int:
    """Run the node until it is told to stop; 2 when a parameter or a file cannot be used."""
    return run_command(lambda: run_node(ProbeNode))


if __name__ == '__main__':
    sys.exit(main())
