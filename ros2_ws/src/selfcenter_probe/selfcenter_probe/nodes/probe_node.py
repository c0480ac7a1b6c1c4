# SPDX-License-Identifier: Apache-2.0
"""The simulated self-centering probe as a node: `ros2 run selfcenter_probe probe`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from calib_interfaces.msg import StylusDisplacements
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_model.arrays import Array
from calib_model.command_line import run_command
from calib_model.descriptions import (
    gauge_yaml,
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    probe_yaml,
    read_description,
)
from calib_model.errors import ParameterError
from calib_model.files import shared_file
from calib_model.nodes import (
    NodeCommand,
    Parameters,
    joints_of,
    lean_executor,
    qos_of,
    run_node,
    stamp_of,
    unheard,
)
from calib_model.stamps import SECOND
from calib_model.topics import (
    DIAGNOSTICS,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
    Topic,
)
from selfcenter_probe.nodes.messages import diagnostics, displacements
from selfcenter_probe.simulation import Health, ProbeSimulation, World, parse_magnitudes

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
DIAGNOSTICS_PERIOD = 1.0  # s


ABOUT = """\
A simulated self-centering probe on the arm whose /joint_states it hears: publishes the styli's
/probe/displacements, /probe_description, /gauge_description, and its health on /diagnostics."""
EXAMPLE = """\
ros2 run selfcenter_probe probe --ros-args -p seed:=3 -p rate:=500.0
  ros2 run selfcenter_probe sim_probe --ros-args -r __ns:=/left"""


@dataclass(frozen=True)
class ProbeParameters:
    """What the probe is told at the start; `rate` in Hz, `max_gap` in s, of the stamps' time."""

    paths: dict[str, str]
    seed: int
    rate: float
    max_gap: float
    clock_offset: int  # ns


def read_parameters(
    node: Any,
    on_rate: Callable[[float], None] = unheard,
    on_gap: Callable[[float], None] = unheard,
) -> ProbeParameters:
    """Declare the probe's parameters on `node`, a Node or a Sheet.

    Raises:
        ParameterError: one of them cannot be used; names it.
    """
    parameters = Parameters(node)
    paths = {
        name: parameters.text(name, '', f'path of a YAML file: {what}; empty: {file} of {package}')
        for name, (package, file, what) in FILES.items()
    }
    text = 'of the world and its noise; -1: the one in the world file'
    seed = parameters.whole('seed', -1, text, -1, 2**62)
    text = 'Hz, readings per second of the stamps'
    rate = parameters.number('rate', 100.0, text, 1.0, 1e4, on_rate)
    text = 's, longest gap to interpolate joints over'
    max_gap = parameters.number('max_gap', 0.1, text, 1e-6, 10.0, on_gap)
    text = "s by which the stamps of readings are behind the joints': two clocks"
    offset = parameters.number('clock_offset', 0.0, text, -10.0, 10.0)
    return ProbeParameters(paths, seed, rate, max_gap, round(offset * SECOND))


def _read(name: str, given: str, parse: Callable[[str, str], T]) -> T:
    """What the file `given` for parameter `name` says, or the one it defaults to."""
    if given:
        return read_description(given, parse)
    package, file, _ = FILES[name]
    path = shared_file(package, file)
    if path is None:
        raise ParameterError(
            f"parameter '{name}' is empty and {package} is not installed: give a path"
        )
    return read_description(path, parse)


class ProbeNode(Node):
    """Reads the world wherever the joint states take the arm, and publishes what the styli say.

    What it publishes as descriptions is what everyone is told, never how it really is.
    """

    def __init__(self) -> None:
        super().__init__('probe')
        given = read_parameters(self, self._set_rate, self._set_gap)
        self._rate, self._max_gap = given.rate, given.max_gap
        paths = given.paths
        arm = _read('arm', paths['arm'], parse_arm)
        probe = _read('probe', paths['probe'], parse_probe)
        gauge = _read('gauge', paths['gauge'], parse_gauge)
        placements = _read('placements', paths['placements'], parse_placements)
        magnitudes = _read('world', paths['world'], parse_magnitudes)
        generator = np.random.default_rng(magnitudes.seed if given.seed < 0 else given.seed)
        of_world, of_readings = generator.spawn(2)
        world = World.drawn(arm, probe, gauge, placements, magnitudes, of_world)
        self._offset = given.clock_offset
        self._simulation = ProbeSimulation(world, of_readings, given.rate, given.max_gap)
        self._frame = probe.name
        self._joint_names = arm.joint_names
        self._stamps: list[int] = []
        self._joints: list[Array] = []
        # due as soon as what waits already has been taken in, on a clock that nobody stops; a task
        # of the executor would do, but ends the process by a signal when it raises
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._due = self.create_timer(0.0, self._read, clock=clock)
        self._due.cancel()
        self._latched = [
            self._latch(PROBE_DESCRIPTION, probe_yaml(replace(probe, simulated=True))),
            self._latch(GAUGE_DESCRIPTION, gauge_yaml(gauge)),
        ]
        self._readings = self.create_publisher(
            StylusDisplacements, PROBE_DISPLACEMENTS.relative, qos_of(PROBE_DISPLACEMENTS)
        )
        self._health = Health()
        self._diagnostics = self.create_publisher(DiagnosticArray, DIAGNOSTICS.relative, 10)
        self.create_timer(DIAGNOSTICS_PERIOD, self._diagnose)
        self.create_subscription(
            JointState,
            JOINT_STATES.relative,
            self._on_joints,
            qos_of(JOINT_STATES, best_effort=True),
        )
        self.get_logger().info(
            f'simulated probe, no hardware: {probe.name} on {arm.name}, {gauge.name} at '
            f'{len(placements)} locations'
        )

    def _set_rate(self, rate: float) -> None:
        self._rate = rate
        self._simulation.pace(self._rate, self._max_gap)

    def _set_gap(self, max_gap: float) -> None:
        self._max_gap = max_gap
        self._simulation.pace(self._rate, self._max_gap)

    def _latch(self, topic: Topic, text: str) -> Publisher:
        publisher = self.create_publisher(String, topic.relative, qos_of(topic))
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
        self._stamps.append(stamp_of(state.header))
        self._joints.append(joints)
        if len(self._stamps) == 1:
            self._due.reset()

    def _read(self) -> None:
        """Read for all states that came together: for ten it takes as long as for two."""
        self._due.cancel()
        stamps, joints = self._stamps, self._joints
        self._stamps, self._joints = [], []
        readings = self._simulation.advance(stamps, np.array(joints)).shifted(-self._offset)
        self._health.take(readings)
        for message in displacements(readings, self._frame):
            self._readings.publish(message)

    def _diagnose(self) -> None:
        report = self._health.report(DIAGNOSTICS_PERIOD)
        self._diagnostics.publish(diagnostics(report, self._frame, time.time_ns()))


COMMAND = NodeCommand('selfcenter_probe', 'probe', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Run the node until it is told to stop; 2 when a parameter or a file cannot be used."""
    return run_command(lambda: run_node(COMMAND, ProbeNode, lean_executor))


if __name__ == '__main__':
    sys.exit(main())
