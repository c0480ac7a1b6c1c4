# SPDX-License-Identifier: Apache-2.0
"""The operator with a hand-guided arm as a node: `ros2 run selfcenter_probe operator`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from calib_interfaces.msg import StylusDisplacements
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_model.command_line import run_command
from calib_model.descriptions import arm_yaml, gauge_yaml, probe_yaml
from calib_model.errors import ParameterError
from calib_model.nodes import NodeCommand, Parameters, qos_of, run_node
from calib_model.stamps import SECOND
from calib_model.topics import DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS, Topic
from selfcenter_probe.nodes.messages import displacements, joint_states
from selfcenter_probe.operator import (
    FILES,
    HandGuided,
    MotionSettings,
    RawStretch,
    Scene,
    guided,
    read_scene,
)

SETTLED = 0.3  # s that somebody has listened: both ends know one another by then
PERIOD = 0.004  # s of the wall clock: how often what is due is published


ABOUT = """\
An operator who leads a measuring arm by hand around the spheres of the bar, simulated: publishes
/joint_states at 250 Hz, /probe/displacements at 500 Hz and the three descriptions."""
EXAMPLE = 'ros2 run selfcenter_probe operator --ros-args -p probe:=active -p poses:=20'
BAD_NUMBERS = "parameter '{}': expected different numbers of {}, got {!r}"


@dataclass(frozen=True)
class OperatorParameters:
    """What the operator is told."""

    scene: Scene
    locations: list[int]
    spheres: list[int]
    motion: MotionSettings
    seed: int
    time_scale: float
    wait: float
    clock_offset: int  # ns


def read_parameters(node: Any) -> OperatorParameters:
    """Declare the operator's parameters on `node`, a Node or a Sheet.

    Raises:
        ParameterError: one of them cannot be used; names it.
        DescriptionError: a file cannot be used.
    """
    parameters = Parameters(node)
    scene = read_scene(
        parameters.text('probe', 'passive', 'passive, active, or a YAML file'),
        {
            name: Path(path)
            if (path := parameters.text(name, '', f'path; empty: {file}'))
            else None
            for name, (_, file, _) in FILES.items()
        },
    )
    locations = _numbers(node, 'locations', list(range(1, 8)), sorted(scene.placements))
    spheres = _numbers(node, 'spheres', [1, 6, 10, 14], list(scene.gauge.numbers))
    poses = parameters.whole('poses', 385, 'per sphere', 2, 10**5)
    seed = parameters.whole('seed', 1, 'of arm, gauge and hand', 0, 10**15)
    speed = parameters.number('speed', 1.0, 'rad/s, of all joints together', 0.01, 10.0)
    scale = parameters.number('time_scale', 1.0, 'times as fast as real', 0.01, 100.0)
    motion = MotionSettings(poses, speed, seed)
    text = 's to wait at most for somebody who listens to both streams'
    wait = parameters.number('wait', 0.0, text, 0.0, 3600.0)
    text = "s by which the stamps of probe readings are behind the joints': two clocks"
    offset = parameters.number('clock_offset', 0.0, text, -10.0, 10.0)
    return OperatorParameters(
        scene, locations, spheres, motion, seed, scale, wait, round(offset * SECOND)
    )


def _numbers(node: Any, name: str, default: list[int], known: list[int]) -> list[int]:
    descriptor = ParameterDescriptor(description=f'of {known}', dynamic_typing=True, read_only=True)
    value = node.declare_parameter(name, default, descriptor).value
    # rcl hands over an empty list as None, lists of numbers as array.array
    scalar = value is None or isinstance(value, str | int | float)
    numbers = [] if scalar else list(value)
    if not numbers or len(set(numbers)) < len(numbers) or not set(numbers) <= set(known):
        raise ParameterError(BAD_NUMBERS.format(name, known, value))
    return numbers


class OperatorNode(Node):
    """Arm and probe in one, moved by a hand: joint states at 250 Hz, probe readings at 500 Hz.

    Stamps begin at the wall clock's time and run `time_scale` times as fast. When the last
    sphere has been probed, the streams end and the node stays.
    """

    def __init__(self) -> None:
        super().__init__('operator')
        given = read_parameters(self)
        scene, hand = given.scene, _hand(given)
        self._scale = given.time_scale
        self._joint_names = scene.arm.joint_names
        self._frames = scene.arm.base_frame, scene.probe.name
        probe = replace(scene.probe, simulated=True)
        texts = (arm_yaml(scene.arm), probe_yaml(probe), gauge_yaml(scene.gauge))
        self._latched = [
            self._latch(topic, text) for topic, text in zip(DESCRIPTIONS, texts, strict=True)
        ]
        self._states = self.create_publisher(
            JointState, JOINT_STATES.relative, qos_of(JOINT_STATES)
        )
        self._readings = self.create_publisher(
            StylusDisplacements, PROBE_DISPLACEMENTS.relative, qos_of(PROBE_DISPLACEMENTS)
        )
        self._offset = given.clock_offset
        self._counts = {self._states: 0, self._readings: 0}
        self._begin = time.time_ns()
        self._wall = time.monotonic_ns()
        self._heard = self._wall + round(SETTLED * SECOND)
        self._patience = self._wall + round(given.wait * SECOND)
        self._sent = self._messages(hand, self._begin - hand.motion.seatings[0].begin)
        self._next = next(self._sent, None)
        self._timer = self.create_timer(PERIOD, self._tick)
        motion = hand.motion
        seconds = (motion.seatings[-1].end - motion.seatings[0].begin) / SECOND / self._scale
        self.get_logger().info(
            f'{scene.arm.name} with {scene.probe.name}, {len(motion.seatings)} seatings in '
            f'{seconds:.0f} s, {len(motion.absent)} spheres out of reach'
        )

    def _messages(self, hand: HandGuided, shift: int) -> Iterator[tuple[int, Publisher, Any]]:
        """Stamp (ns), publisher and message, in time order; messages are filled anew each time."""
        for stretch in hand.raw():
            yield from self._of(stretch, shift)

    def _of(self, stretch: RawStretch, shift: int) -> Iterator[tuple[int, Publisher, Any]]:
        frame_of_arm, frame_of_probe = self._frames
        stamps = stretch.stamp + shift
        states = joint_states(stamps, stretch.joints, self._joint_names, frame_of_arm)
        readings = stretch.readings.shifted(shift)
        read = displacements(readings.shifted(-self._offset), frame_of_probe)
        ticks = set(stamps.tolist())
        for stamp in readings.stamp.tolist():
            if stamp in ticks:
                yield stamp, self._states, next(states)
            yield stamp, self._readings, next(read)

    def _wanted(self) -> bool:
        """Whether to begin: somebody has been listening for a while, or has not come in time."""
        if not self._patience:
            return True
        wall = time.monotonic_ns()
        if not all(publisher.get_subscription_count() for publisher in self._counts):
            self._heard = wall + round(SETTLED * SECOND)
        if wall < min(self._heard, self._patience):
            return False
        self._wall, self._patience = wall, 0
        return True

    def _tick(self) -> None:
        if not self._wanted():
            return
        now = self._begin + round((time.monotonic_ns() - self._wall) * self._scale)
        while self._next is not None and self._next[0] <= now:
            _, publisher, message = self._next
            publisher.publish(message)
            self._counts[publisher] += 1
            self._next = next(self._sent, None)
        if self._next is None:
            self._timer.cancel()
            states, readings = self._counts.values()
            self.get_logger().info(
                f'every sphere has been probed: {states} joint states, {readings} readings'
            )

    def _latch(self, topic: Topic, text: str) -> Publisher:
        publisher = self.create_publisher(String, topic.relative, qos_of(topic))
        publisher.publish(String(data=text))
        return publisher


def _hand(given: OperatorParameters) -> HandGuided:
    world = given.scene.world(given.seed)
    sides = {number: given.scene.placements[number] for number in given.locations}
    return HandGuided(world, guided(world, sides, given.spheres, given.motion), given.seed)


COMMAND = NodeCommand('selfcenter_probe', 'operator', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Run the node until it is told to stop; 2 when a parameter or a file cannot be used."""
    return run_command(lambda: run_node(COMMAND, OperatorNode))


if __name__ == '__main__':
    sys.exit(main())
