# SPDX-License-Identifier: Apache-2.0
"""The simulated arm as a node: `ros2 run calib_capture arm`."""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message
from rclpy.timer import Timer
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from calib_capture.motion import (
    StrictController,
    Trajectory,
    TrajectoryError,
    check_trajectory,
    checked_trajectory,
)
from calib_capture.nodes.arm_parameters import read_parameters
from calib_capture.nodes.messages import joint_state, points_of
from calib_capture.nodes.trajectory_action import serve_goals
from calib_capture.recording import read_trajectory_cdr
from calib_model.arrays import Array
from calib_model.command_line import run_command
from calib_model.descriptions import SIMULATED, Standing, arm_yaml, standing_yaml
from calib_model.instruments import PostureNoise
from calib_model.nodes import NodeCommand, lean_executor, qos_of, run_node, stamp_of
from calib_model.stamps import SECOND
from calib_model.topics import (
    ARM_DESCRIPTION,
    JOINT_STATES,
    ROBOT_DESCRIPTION,
    Topic,
    commanded,
)
from calib_model.urdf import arm_urdf

ABOUT = """\
A simulated arm: follows trajectories on /arm_controller/joint_trajectory as ros2_control's
joint_trajectory_controller does, and the action /arm_controller/follow_joint_trajectory where
control_msgs is installed; publishes /joint_states, /arm_description, /robot_description.

It is as strict as a real one. It rejects what that controller rejects, with the reason, and goes on
with what it was doing. Beyond a limit of position, velocity, acceleration or jerk, between points
too, it stops with a line that begins with FAULT, and takes nothing more."""
EXAMPLE = """\
ros2 run calib_capture arm --ros-args -p time_scale:=5.0
  ros2 run calib_capture sim_arm --ros-args -r __ns:=/left"""
STEPPED_IDLE = 0.05  # s: in stepped simulation an arm at rest lives in real time, at this beat
STEPPED_BURST = 40  # states published at once: less than half of what a subscriber keeps
STEPPED_PAUSE = 0.025  # s between bursts of one motion: what subscribers in Python keep up with
SETTLED, READ = 6, 3  # states: for the last of a motion to be over, and to see that it is
STEPPED_PATIENCE = 0.2  # s before an arm counts as at rest, not as waiting for the next goal


class ArmNode(Node):
    """Follows trajectories as ros2_control's joint_trajectory_controller does, in its own time.

    Its time runs `time_scale` times as fast as the wall clock's. With `time_scale` 0 the
    simulation is stepped: at rest time runs as the wall clock's, a motion takes no time at all
    and only those of its states are published that matter.
    """

    def __init__(self) -> None:
        super().__init__('arm')
        given = read_parameters(self, self._set_rate, self._set_scale)
        self._given, self._arm = given, given.arm
        self._rate, self._scale = given.rate, given.time_scale
        self._publish_descriptions()
        self._states = self.create_publisher(
            JointState, JOINT_STATES.relative, qos_of(JOINT_STATES)
        )
        self._noise = PostureNoise(np.random.default_rng(1))
        self._stands: Array = np.zeros(0)
        self._time = self._beginning()  # of the last published state, in the arm's own time
        self._wall = time.monotonic_ns()
        log = self.get_logger()
        self.controller = StrictController(
            self._arm, given.limits, self._time, log.error, given.start
        )
        self._steps: list[int] = []
        self._rested = 0.0
        topic = commanded(given.controller)
        qos = qos_of(topic)
        self.create_subscription(
            JointTrajectory, topic.relative, self._on_trajectory, qos, raw=True
        )
        self._timer = self._beating()
        self.get_logger().info(
            f'simulated arm, no hardware: {self._arm.name}, {self._arm.n} joints, {self._speed()}'
        )
        self._goals = serve_goals(self, given.controller, self)

    def _beginning(self) -> int:
        """Now, ns; of a stepped arm the last whole second, so that whoever reads at whole parts of
        a second reads at the same moments of its motions each time."""
        now = time.time_ns()
        return now if self._scale > 0 else now - now % SECOND

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
            instants = self.controller.instants()
            self._steps = instants[instants > self._time].tolist()
        self._rate, self._scale = rate, scale
        self._timer = self._beating()
        self.get_logger().info(self._speed())

    def _publish_descriptions(self) -> None:
        self._latched = [
            self._latch(ARM_DESCRIPTION, arm_yaml(self._arm) + standing_yaml(self._standing())),
            self._latch(ROBOT_DESCRIPTION, arm_urdf(self._arm)),
        ]

    def _standing(self) -> Standing:
        """What suits this arm: states that come seldom tell late that it has come to rest."""
        apart = self._scale / self._rate
        return replace(
            SIMULATED,
            settle=max(SIMULATED.settle, SETTLED * apart),
            dwell=max(SIMULATED.dwell, READ * apart),
        )

    def _latch(self, topic: Topic, text: str) -> Publisher:
        publisher = self.create_publisher(String, topic.relative, qos_of(topic))
        publisher.publish(String(data=text))
        return publisher

    def _on_trajectory(self, raw: bytes) -> None:
        trajectory = read_trajectory_cdr(raw, self._arm.joint_names)
        if trajectory is None:
            reason = self.take(deserialize_message(raw, JointTrajectory))
        else:
            reason = self._checked(trajectory) or self._follow(trajectory, 0)
        if reason:
            self.get_logger().warning(f'rejected: {reason}')

    def take(self, message: JointTrajectory) -> str:
        """Follow a trajectory from now on, or say why not; what was left of the one before is
        forgotten then."""
        try:
            trajectory = checked_trajectory(self._arm, *points_of(message))
        except TrajectoryError as error:
            return str(error)
        return self._follow(trajectory, stamp_of(message.header))

    def _checked(self, trajectory: Trajectory) -> str:
        try:
            check_trajectory(trajectory)
        except TrajectoryError as error:
            return str(error)
        return ''

    def _follow(self, trajectory: Trajectory, start: int) -> str:
        try:
            self.controller.follow(trajectory, self._advance_clock(), start)
        except TrajectoryError as error:
            return str(error)
        if self._scale == 0:
            self._steps = self.controller.instants()[1:].tolist()
            self._step()
        return ''

    def hold(self) -> None:
        """Stop at once, as the controller does when a goal is cancelled."""
        self.controller.hold(self._advance_clock())
        self._steps = []

    @property
    def failure(self) -> str:
        """What stopped the arm for good; empty while it works."""
        return self.controller.failed

    @property
    def busy(self) -> bool:
        """Whether a trajectory is still under way."""
        return bool(self._steps) or self.controller.busy(self._time)

    def _advance_clock(self) -> int:
        """Bring the arm's time to now, and return it."""
        wall = time.monotonic_ns()
        if self._scale > 0:
            self._time += round((wall - self._wall) * self._scale)
        self._wall = wall
        return self._time

    def _tick(self) -> None:
        self._advance_clock()
        self._publish(self._time)

    def _step(self) -> None:
        """Publish the next states of a stepped motion, all of them when they are few."""
        now, self._steps = self._steps[:STEPPED_BURST], self._steps[STEPPED_BURST:]
        for stamp in now:
            self._publish(stamp)
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
        state = self.controller.at(stamp)
        names, frame = self._arm.joint_names, self._arm.base_frame
        seen = self._seen(state.position)
        self._states.publish(joint_state(stamp, frame, names, seen, state.velocity))

    def _seen(self, position: Array) -> Array:
        """The joints (n,) as the encoders tell them."""
        noise, step = self._given.noise, self._given.step
        if noise:
            if not np.array_equal(position, self._stands):
                self._stands, self._scatter = position, self._noise.arriving(position)
            position = position + self._scatter.normal(0.0, noise, len(position))
        return np.round(position / step) * step if step else position


COMMAND = NodeCommand('calib_capture', 'arm', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Run the node until it is told to stop; 2 when a parameter or a file cannot be used."""
    return run_command(lambda: run_node(COMMAND, ArmNode, lean_executor))


if __name__ == '__main__':
    sys.exit(main())
