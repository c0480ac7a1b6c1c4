# SPDX-License-Identifier: Apache-2.0
"""A minute before an hour: `ros2 run calib_capture check`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rclpy
from calib_interfaces.msg import StylusDisplacements
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_capture.checking import OK, WRONG, Check, Finding, Heard, SmallMove
from calib_capture.motion import Trajectory
from calib_capture.nodes.arm_commander import ArmCommander
from calib_model.command_line import run_command
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.errors import ParameterError
from calib_model.instruments import ActiveProbe
from calib_model.nodes import (
    NodeCommand,
    Parameters,
    init,
    joints_of,
    lean_executor,
    qos_of,
    stamp_of,
    warn_of_unknown,
)
from calib_model.pairing import JointSample, Reading
from calib_model.topics import (
    ARM_DESCRIPTION,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
)

ABOUT = """\
Checks a live arm and probe before they are believed, with the probe on one sphere: topics, rates,
stamps and clocks, units and signs of joints and styli, noise, mounting. A line each: ok, doubtful
or wrong, and what to do. To tell signs it moves one joint after the other by some mrad, within the
styli's stroke: stand by with the emergency stop. Exit code 0, or 1 when something is wrong."""
EXAMPLE = """\
ros2 run calib_capture check --ros-args -p arm:=my_arm.yaml -p probe:=my_probe.yaml \\
    -p gauge:=my_gauge.yaml -p move:=false"""
DESCRIPTIONS = {
    'arm': (ARM_DESCRIPTION, parse_arm),
    'probe': (PROBE_DESCRIPTION, parse_probe),
    'gauge': (GAUGE_DESCRIPTION, parse_gauge),
}
TICK = 0.02  # s
T = TypeVar('T')


@dataclass(frozen=True)
class CheckParameters:
    """What the check is told; `paths` of descriptions are empty where a topic tells."""

    paths: dict[str, str]
    move: bool
    seconds: float
    wait_timeout: float


def read_parameters(node: Any) -> CheckParameters:
    """Declare the check's parameters on `node`, a Node or a Sheet.

    Raises:
        ParameterError: one of them cannot be used; names it.
    """
    parameters = Parameters(node)
    text = 'path of a YAML file: the description; empty: the one on the topic'
    return CheckParameters(
        {key: parameters.text(key, '', text) for key in DESCRIPTIONS},
        parameters.flag('move', True, 'whether joints are moved; if not, no sign is told'),
        parameters.number('seconds', 2.0, 's of both streams that are looked at', 0.5, 60.0),
        parameters.number('wait_timeout', 5.0, 's to wait for descriptions', 0.1, 1e5),
    )


class CheckNode(Node):
    """Hears both streams and moves the arm a little."""

    def __init__(self) -> None:
        super().__init__('check')
        self.asked = read_parameters(self)
        self.heard = Heard()
        self.commanding = ArmCommander(self)
        self._texts: dict[str, str] = {}
        self._unnamed: set[str] = set()  # joints of states in which ours are not
        for key, (topic, _) in DESCRIPTIONS.items():
            if not self.asked.paths[key]:
                self.create_subscription(String, topic.relative, self._keep(key), qos_of(topic))

    def _keep(self, key: str) -> Callable[[String], None]:
        def keep(message: String) -> None:
            self._texts[key] = message.data

        return keep

    def missing(self) -> str:
        """Topics of descriptions that have not come."""
        topics = (
            topic.name
            for key, (topic, _) in DESCRIPTIONS.items()
            if not self.asked.paths[key] and key not in self._texts
        )
        return ', '.join(topics)

    def describe(self) -> None:
        """Read arm, probe and gauge.

        Raises:
            DescriptionError: one cannot be used.
            ParameterError: the probe gives no readings.
        """
        self.arm = self._described('arm', parse_arm)
        probe = self._described('probe', parse_probe)
        self.gauge = self._described('gauge', parse_gauge)
        if not isinstance(probe, ActiveProbe):
            raise ParameterError(f'{probe.name} is a passive probe: it has no readings to check')
        self.probe = probe

    def _described(self, key: str, parse: Callable[[str, str], T]) -> T:
        if self.asked.paths[key]:
            return read_description(self.asked.paths[key], parse)
        return parse(self._texts[key], DESCRIPTIONS[key][0].name)

    def listen(self) -> None:
        """Take in both streams from now on."""
        for kind, topic, take in (
            (JointState, JOINT_STATES, self._on_joints),
            (StylusDisplacements, PROBE_DISPLACEMENTS, self._on_reading),
        ):
            self.create_subscription(kind, topic.relative, take, qos_of(topic, best_effort=True))

    def _on_joints(self, state: JointState) -> None:
        joints = joints_of(state, self.arm.joint_names)
        if joints is None:
            self._unnamed.update(state.name)
            return
        self.heard.take(JointSample(stamp_of(state.header), joints), time.monotonic())

    def _on_reading(self, message: StylusDisplacements) -> None:
        first, second, third = message.status.tolist()
        reading = Reading(stamp_of(message.header), message.displacement, (first, second, third))
        self.heard.take(reading, time.monotonic())

    def heard_both(self) -> bool:
        """Whether both streams have begun."""
        return bool(self.heard.joints and self.heard.readings)

    def topic_findings(self) -> list[Finding]:
        """Whether both streams come, each from one node."""
        findings = []
        for topic, came in (
            (JOINT_STATES, self.heard.joints),
            (PROBE_DISPLACEMENTS, self.heard.readings),
        ):
            count = len(self.get_publishers_info_by_topic(topic.relative))
            if came and count <= 1:
                findings.append(Finding(topic.name, OK, 'one publisher'))
            elif came:
                advice = 'let one node alone publish it'
                findings.append(Finding(topic.name, WRONG, f'{count} publishers', advice))
            else:
                findings.append(self._nothing(topic.name, count))
        return findings

    def _nothing(self, topic: str, publishers: int) -> Finding:
        if topic == JOINT_STATES.name and self._unnamed:
            seen = f'no {", ".join(self.arm.joint_names)} in it, but {", ".join(self._unnamed)}'
            return Finding(topic, WRONG, seen, 'use the names of the arm description')
        seen = f'nothing came, {publishers} publishers'
        return Finding(topic, WRONG, seen, 'start the driver, or remap its topic')

    def listening(self) -> bool:
        """Whether somebody takes commands."""
        return self.commanding.heard()

    def problem(self) -> str:
        """What the controller says against the last command: by the topic it says nothing."""
        return self.commanding.problem

    def send(self, move: SmallMove) -> None:
        """Command one small motion: at rest at each of its points."""
        rest = np.zeros_like(move.positions)
        trajectory = Trajectory(move.seconds, move.positions, rest, rest)
        self.commanding.send(self.arm.joint_names, trajectory)

    def spin(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Take messages in for so long, or until something is so."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.executor.spin_once(timeout_sec=TICK)


def _say(finding: Finding) -> None:
    print(finding.line(), flush=True)


def _run(node: CheckNode) -> int:
    """From waiting to the verdict; the exit code."""
    node.spin(node.asked.wait_timeout, until=lambda: not node.missing())
    if missing := node.missing():
        advice = 'start what publishes them, or name files'
        _say(Finding('descriptions', WRONG, f'{missing} did not come', advice))
        return 1
    node.describe()
    node.listen()
    node.spin(node.asked.wait_timeout, until=node.heard_both)
    check = Check(node.arm, node.probe, node.gauge, node, _say)
    check.look(node.asked.seconds)
    if not node.asked.move:
        check.leave_out('nothing moves', 'move:=true tells them')
    elif check.barred or not node.heard_both():
        check.leave_out('the arm was not moved', 'mend what is wrong first, then check again')
    else:
        node.commanding.take()
        try:
            check.move()
        finally:
            node.commanding.leave()
    return int(check.wrong)


COMMAND = NodeCommand('calib_capture', 'check', ABOUT, EXAMPLE, read_parameters)


def _check() -> int:
    COMMAND.parse(sys.argv)
    init(sys.argv)
    node: CheckNode | None = None
    try:
        node = CheckNode()
        warn_of_unknown(node)
        executor = lean_executor()
        executor.add_node(node)
        return _run(node)
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Check arm and probe; 0, 1 when something is wrong, 2 when there is nothing to check."""
    return run_command(_check)


if __name__ == '__main__':
    sys.exit(main())
