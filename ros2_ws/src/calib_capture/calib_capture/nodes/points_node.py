# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture capture_points`: a tracker's points, live, with the arm's postures."""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from calib_interfaces.msg import MeasuredPoint
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_capture.recording import PointSession, TrackedPoint
from calib_model.command_line import run_command
from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import ParameterError
from calib_model.instruments import Arm
from calib_model.nodes import (
    NodeCommand,
    Parameters,
    joints_of,
    lean_executor,
    qos_of,
    run_node,
    stamp_of,
)
from calib_model.pairing import JointSample
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POINTS, JOINT_STATES
from calib_model.tracking import StandingSettings

TICK = 0.1  # s
HEADER, RECEIVED = 'header', 'received'

ABOUT = """\
Records what a laser tracker or a camera system measures of targets on the flange: each
calib_interfaces/msg/MeasuredPoint on /capture/points gets the posture in which the arm stood, from
/joint_states, and goes into a bag that identify takes. No gauge and no probe. The arm is moved by
whoever moves it; a point that comes while it moves is refused. Ctrl-C ends it."""
EXAMPLE = """\
ros2 run calib_capture capture_points --ros-args -p output:=output/tracked -p arm:=my_arm.yaml"""


class PointsNode(Node):
    """Hears an arm and a tracker, and records the points once the arm is described."""

    def __init__(self) -> None:
        super().__init__('capture_points')
        asked = read_parameters(self)
        self._output, self._received = asked['output'], asked['stamps'] == RECEIVED
        self._settings = StandingSettings(asked['before'], asked['after'], asked['still'])
        self._session: PointSession | None = None
        self._arm: Arm | None = None
        if asked['arm']:
            self._begin(read_description(asked['arm'], parse_arm))
        else:
            topic = ARM_DESCRIPTION
            self.create_subscription(String, topic.relative, self._described, qos_of(topic))
        states = qos_of(JOINT_STATES, best_effort=True)
        self.create_subscription(JointState, JOINT_STATES.relative, self._on_joints, states)
        points = qos_of(CAPTURE_POINTS)
        self.create_subscription(MeasuredPoint, CAPTURE_POINTS.relative, self._on_point, points)
        # of the wall's time, also where a bag's time rules
        self.create_timer(TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _begin(self, arm: Arm) -> None:
        self._arm = arm
        self._session = PointSession(
            self._output,
            arm,
            self._settings,
            self._received,
            self._say,
            time.monotonic,
            time.time_ns,
        )
        self._say(f'ready: points of {arm.name} go to {self._output}')

    def _described(self, message: String) -> None:
        arm = parse_arm(message.data, ARM_DESCRIPTION.name)
        if self._arm is None:
            self._begin(arm)
        elif arm != self._arm:
            self._say(f'{ARM_DESCRIPTION.name}: another arm is described now; start anew for it')

    def _on_joints(self, message: JointState) -> None:
        if self._session is None or self._arm is None:
            return
        joints = joints_of(message, self._arm.joint_names)
        if joints is not None:
            self._session.see(JointSample(stamp_of(message.header), joints))

    def _on_point(self, message: MeasuredPoint) -> None:
        if self._session is None:
            self._say(f'refused: {ARM_DESCRIPTION.name} has not come, and no arm was given')
            return
        self._session.take(
            TrackedPoint(
                stamp_of(message.header),
                message.target,
                int(message.station),
                np.array(message.position),
                np.array(message.orientation),
                float(message.sigma),
                np.array(message.joint_position),
            )
        )

    def _tick(self) -> None:
        if self._session is not None:
            self._session.tick()

    def _say(self, line: str) -> None:
        print(line, flush=True)

    def end(self) -> None:
        """Finish the bag."""
        if self._session is not None:
            self._session.close()
            self._say(self._session.tally.line())


def read_parameters(node: Any) -> dict[str, Any]:
    """The node's parameters by name.

    Raises:
        ParameterError: one is not as expected.
    """
    default, parameters = StandingSettings(), Parameters(node)
    asked = {
        'output': parameters.text('output', 'points', 'folder of the bag that is written'),
        'arm': parameters.text(
            'arm', '', f'path of an arm description; empty: what {ARM_DESCRIPTION.name} says'
        ),
        'stamps': parameters.text(
            'stamps',
            HEADER,
            f'{HEADER}: a point was measured when its header says, by the clock of the joint '
            f'states; {RECEIVED}: when it comes',
        ),
        'before': parameters.number(
            'before', default.before, 's that the arm stands before a point is measured', 0.0, 4.0
        ),
        'after': parameters.number('after', default.after, 's that it stands after it', 0.0, 4.0),
        'still': parameters.number(
            'still',
            default.still,
            'rad, m of a prismatic joint: by how much a standing one may be seen to move',
            0.0,
            0.1,
        ),
    }
    if asked['stamps'] not in (HEADER, RECEIVED):
        given = asked['stamps']
        raise ParameterError(f"parameter 'stamps': expected {HEADER} or {RECEIVED}, got {given!r}")
    return asked


COMMAND = NodeCommand('calib_capture', 'capture_points', ABOUT, EXAMPLE, read_parameters)


def main() -> int:
    """Record points until Ctrl-C or SIGTERM; 2 when that cannot be done."""
    return run_command(lambda: run_node(COMMAND, PointsNode, lean_executor, PointsNode.end))


if __name__ == '__main__':
    sys.exit(main())
