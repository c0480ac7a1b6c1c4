# SPDX-License-Identifier: Apache-2.0
"""The simulated arm as a node: `ros2 run calib_capture arm`."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from calib_capture.default_files import configured, explained
from calib_capture.motion import Motion, PinocchioArm, TrajectoryError, checked_trajectory
from calib_capture.nodes.messages import joint_state, points_of
from calib_model.arrays import Array
from calib_model.command_line import run_command
from calib_model.descriptions import arm_yaml, parse_arm
from calib_model.instruments import Arm
from calib_model.nodes import NodeCommand, Parameters, lean_executor, qos_of, run_node
from calib_model.stamps import SECOND
from calib_model.topics import (
    ARM_DESCRIPTION,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    ROBOT_DESCRIPTION,
    Topic,
)
from calib_model.urdf import arm_urdf

ABOUT = """\
A simulated arm: follows trajectories on /arm_controller/joint_trajectory as ros2_control's
joint_trajectory_controller does; publishes /joint_states, /arm_description, /robot_description."""
EXAMPLE = """\
ros2 run calib_capture arm --ros-args -p time_scale:=5.0
  ros2 run calib_capture sim_arm --ros-args -r __ns:=/left"""
STEPPED_IDLE = 0.05  # s: in stepped simulation an arm at rest lives in real time, at this beat
STEPPED_BURST = 40  # states published at once: less than half of what a subscriber keeps
STEPPED_PAUSE = 0.025  # s between bursts of one motion: what subscribers in Python keep up with
STEPPED_PATIENCE = 0.2  # s before an arm counts as at rest, not as waiting for the next goal


def _nothing(_: float) -> None:
    """What a change does to no node."""


@dataclass(frozen=True)
class ArmParameters:
    """What the arm is told at the start; `rate` is in Hz of the wall clock."""

    arm: Arm
    rate: float
    time_scale: float


def read_parameters(
    node: Any,
    on_rate: Callable[[float], None] = _nothing,
    on_scale: Callable[[float], None] = _nothing,
) -> ArmParameters:
    """Declare the arm's parameters on `node`, a Node or a Sheet.

    Raises:
        ParameterError: one of them cannot be used; names it.
        DescriptionError: the arm cannot be read.
    """
    parameters = Parameters(node)
    path = parameters.text('arm', '', explained('arm'))
    text = 'joint states per second of the wall clock'
    rate = parameters.number('rate', 250.0, text, 1.0, 1000.0, on_rate)
    text = 'how many times faster than real the arm lives, 0: stepped, as fast as can be'
    scale = parameters.number('time_scale', 1.0, text, 0.0, 1000.0, on_scale)
    return ArmParameters(configured('arm', path, parse_arm), rate, scale)


class ArmNode(Node):
    """Follows trajectories as ros2_control's joint_trajectory_controller does, in its own time.

    Its time runs `time_scale` times as fast as the wall clock's. With `time_scale` 0 the
    simulation is stepped: at rest time runs as the wall clock's, a motion takes no time at all
    and only those of its states are published that matter.
    """

    def __init__(self) -> None:
        super().__init__('arm')
        given = read_parameters(self, self._set_rate, self._set_scale)
        self._arm, self._rate, self._scale = given.arm, given.rate, given.time_scale
        # the model that the arm moves by: its limits and speeds are the description's
        self._model = PinocchioArm(self._arm).model
        self._publish_descriptions()
        self._states = self.create_publisher(
            JointState, JOINT_STATES.relative, qos_of(JOINT_STATES)
        )
        self._time = time.time_ns()  # of the last published state, in the arm's own time
        self._wall = time.monotonic_ns()
        self._began = self._time
        self._motion = Motion.resting(self._start_posture())
        self._steps: list[float] = []
        self._rested = 0.0
        self.create_subscription(
            JointTrajectory,
            JOINT_TRAJECTORY.relative,
            self._on_trajectory,
            qos_of(JOINT_TRAJECTORY),
        )
        self._timer = self._beating()
        self.get_logger().info(
            f'simulated arm, no hardware: {self._arm.name}, {self._arm.n} joints, {self._speed()}'
        )

    def _beating(self) -> Timer:
        if self._scale > 0:
            return self.create_timer(1.0 / self._rate, self._tick)
        return self.create_timer(STEPPED_PAUSE, self._beat)

    def _speed(self) -> str:
        if not self._scale:
            return 'stepped'
        step = self._scale / self._rate * 1e3
        return f'{self._scale:g} times real time, a state every {step:.3g} ms of its own time'

    def _set_rate(self, rate: float) -> None:
        self._pace(rate, self._scale)

    def _set_scale(self, scale: float) -> None:
        self._pace(self._rate, scale)

    def _pace(self, rate: float, scale: float) -> None:
        """Go on at another pace; a motion under way is gone on with."""
        self._advance_clock()
        self.destroy_timer(self._timer)
        if scale == 0 < self._scale:
            instants = self._motion.instants()
            self._steps = instants[instants > (self._time - self._began) / SECOND].tolist()
        self._rate, self._scale = rate, scale
        self._timer = self._beating()
        self.get_logger().info(self._speed())

    def _start_posture(self) -> Array:
        lower, upper = self._model.lowerPositionLimit, self._model.upperPositionLimit
        posture: Array = np.clip(np.zeros(self._arm.n), lower, upper)
        return posture

    def _publish_descriptions(self) -> None:
        self._latched = [
            self._latch(ARM_DESCRIPTION, arm_yaml(self._arm)),
            self._latch(ROBOT_DESCRIPTION, arm_urdf(self._arm)),
        ]

    def _latch(self, topic: Topic, text: str) -> Publisher:
        publisher = self.create_publisher(String, topic.relative, qos_of(topic))
        publisher.publish(String(data=text))
        return publisher

    def _on_trajectory(self, message: JointTrajectory) -> None:
        here = self._advance_clock()
        if not message.points:
            self._follow(Motion.resting(here))
            return
        try:
            seconds, positions = points_of(message)
            trajectory = checked_trajectory(self._arm, message.joint_names, seconds, positions)
        except TrajectoryError as error:
            self.get_logger().warning(f'refused: {error}')
            return
        self._follow(Motion(here, trajectory, self._model.velocityLimit))

    def _follow(self, motion: Motion) -> None:
        """Take on a motion; what was left of the one before is forgotten."""
        self._motion, self._began = motion, self._time
        if self._scale == 0:
            self._steps = motion.instants()[1:].tolist()
            self._step()

    def _advance_clock(self) -> Array:
        """Bring the arm's time to now and return where the arm is."""
        wall = time.monotonic_ns()
        if self._scale > 0:
            self._time += round((wall - self._wall) * self._scale)
        self._wall = wall
        position, _ = self._motion.at((self._time - self._began) / SECOND)
        return position

    def _tick(self) -> None:
        self._advance_clock()
        self._publish(self._time)

    def _step(self) -> None:
        """Publish the next states of a stepped motion, all of them when they are few."""
        now, self._steps = self._steps[:STEPPED_BURST], self._steps[STEPPED_BURST:]
        for seconds in now:
            self._publish(self._began + round(seconds * SECOND))
        self._rested = -STEPPED_PATIENCE

    def _beat(self) -> None:
        """Go on with a long motion, or let time pass for an arm at rest."""
        if self._steps:
            self._step()
            return
        self._rested += STEPPED_PAUSE
        if self._rested >= STEPPED_IDLE:
            self._publish(self._time + round(STEPPED_IDLE * SECOND))
            self._rested = 0.0

    def _publish(self, stamp: int) -> None:
        self._time = stamp
        position, velocity = self._motion.at((stamp - self._began) / SECOND)
        names, frame = self._arm.joint_names, self._arm.base_frame
        self._states.publish(joint_state(stamp, frame, names, position, velocity))


COMMAND = NodeCommand('calib_capture', 'arm', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Run the node until it is told to stop; 2 when a parameter or a file cannot be used."""
    return run_command(lambda: run_node(COMMAND, ArmNode, lean_executor))


if __name__ == '__main__':
    sys.exit(main())
