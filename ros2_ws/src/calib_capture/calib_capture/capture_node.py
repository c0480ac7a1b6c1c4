# SPDX-License-Identifier: Apache-2.0
"""The capture node: `ros2 run calib_capture capture`."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from types import FrameType
from typing import Any, TypeVar

import numpy as np
import rclpy
from calib_interfaces.msg import ProbingPose, StylusDisplacements
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from calib_capture.configuration import ParameterError, configured, explained, number_within
from calib_capture.executor_node import lean_executor
from calib_capture.messages import described, joint_trajectory, joints_of, qos_of, stamp_of
from calib_capture.pairing import JointSample, Pairing, Reading, SteadySettings
from calib_capture.program import Planner, Program, ProgramSettings
from calib_capture.progress import Progress
from calib_capture.recorder import Recorder
from calib_capture.run import MeasuringRun, RunError, RunSettings
from calib_capture.session import CaptureSession
from calib_capture.trajectory import Trajectory
from calib_model.command import run_command
from calib_model.description import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.placement import parse_placements
from calib_model.topics import (
    ARM_DESCRIPTION,
    CAPTURE_POSES,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
    Topic,
)

T = TypeVar('T')
TICK = 0.02  # s
REMINDER = 3.0  # s between two lines that say what is being waited for
DESCRIPTIONS = {'arm': ARM_DESCRIPTION, 'probe': PROBE_DESCRIPTION, 'gauge': GAUGE_DESCRIPTION}
INTERRUPTED = 128  # plus the signal's number: the shell's exit code for it


class CaptureNode(Node):
    """Runs a measuring program on an arm and a probe that it knows by their topics alone.

    `gather` waits for the descriptions, `plan` makes the program, `await_streams` waits for the
    arm and the probe, `begin` starts a session that then lives on messages and timer ticks.
    """

    def __init__(self) -> None:
        super().__init__('capture')
        self._texts: dict[str, str] = {}
        self._parameters_read()
        self._session: CaptureSession | None = None
        self._sampled = self._read = False
        self._joint_names: tuple[str, ...] = ()
        self.failure: RunError | None = None
        self._commands = self.create_publisher(
            JointTrajectory, JOINT_TRAJECTORY.name, qos_of(JOINT_TRAJECTORY)
        )
        self._poses = self.create_publisher(ProbingPose, CAPTURE_POSES.name, qos_of(CAPTURE_POSES))
        self._listen_for_descriptions()

    def _parameters_read(self) -> None:
        text = 'path of a YAML file: the description; empty: the one on the topic'
        self._paths = {key: self._text(key, '', text) for key in DESCRIPTIONS}
        self._placements = configured(
            'placements', self._text('placements', '', explained('placements')), parse_placements
        )
        self._locations = self._integers('locations', 'to visit; empty: all that have a place')
        self.output = self._text('output', 'capture', 'bag to write, a folder that is not there')
        self._program_settings = self._program_parameters()
        self._steady = SteadySettings(
            settle=self._number('settle', 0.01, 's that the arm must be still first', 0.0, 60.0),
            dwell=self._number('dwell', 0.03, 's of readings that are averaged', 1e-3, 60.0),
            max_spread=self._number(
                'max_spread', 2e-5, 'm between readings of one pose, at most', 0.0, 1.0
            ),
            lateness=self._number('lateness', 0.0, 's that a message may be late', 0.0, 60.0),
        )
        self._run_settings = RunSettings(
            speed=self._number('speed', 0.3, 'of each joint, share of its limit', 1e-3, 1.0),
            batch=self._whole('batch', RunSettings.batch, 'poses commanded at once', 1, 100),
            hold=self._steady.settle + self._steady.dwell + self._number(
                'rest', 0.02, 's that a pose is held beyond settle and dwell', 0.0, 60.0),
            answer_timeout=self._number(
                'answer_timeout', 3.0, 's a still arm may leave poses unanswered', 0.1, 3600.0),
            give_up=self._number(
                'give_up', 30.0, 's without any answered pose that end the run', 0.1, 1e5),
        )  # fmt: skip
        self._wait_timeout = self._number(
            'wait_timeout', 30.0, 's to wait for arm and probe', 0.1, 1e5
        )

    def _program_parameters(self) -> ProgramSettings:
        default = ProgramSettings()
        text = f'numbers of the spheres to probe; empty: {default.spheres}'
        spheres = self._integers('spheres', text)
        offsets = self.declare_parameter(
            'offsets', list(default.offset), described('m, the range of offsets in the probe')
        ).value
        if len(offsets) != 2 or not 0 <= offsets[0] <= offsets[1]:
            raise ParameterError("parameter 'offsets': expected [shortest, longest] in m")
        return ProgramSettings(
            spheres=spheres or default.spheres,
            poses_per_sphere=self._whole(
                'poses_per_sphere', default.poses_per_sphere, 'postures around each', 1, 10**5),
            cap=np.radians(self._number(
                'cap', 70.0, 'deg around the gauge s z from which spheres are probed', 0.0, 180.0)),
            offset=(float(offsets[0]), float(offsets[1])),
            seed=self._whole('seed', default.seed, 'of the program', 0, 2**62),
        )  # fmt: skip

    def _text(self, name: str, default: str, text: str) -> str:
        return str(self.declare_parameter(name, default, described(text)).value)

    def _number(self, name: str, default: float, text: str, lower: float, upper: float) -> float:
        value = self.declare_parameter(name, default, described(text, dynamic=True)).value
        return number_within(name, value, lower, upper)

    def _whole(self, name: str, default: int, text: str, lower: int, upper: int) -> int:
        value = self.declare_parameter(name, default, described(text)).value
        return int(number_within(name, value, lower, upper))

    def _integers(self, name: str, text: str) -> tuple[int, ...]:
        kind = Parameter.Type.INTEGER_ARRAY
        return tuple(self.declare_parameter(name, kind, described(text)).value or ())

    def _listen_for_descriptions(self) -> None:
        for key, topic in DESCRIPTIONS.items():
            if not self._paths[key]:
                self._subscribe_description(key, topic)

    def _subscribe_description(self, key: str, topic: Topic) -> None:
        def keep(message: String) -> None:
            self._texts.setdefault(key, message.data)

        self.create_subscription(String, topic.name, keep, qos_of(topic))

    def _description(self, key: str, parse: Callable[[str, str], T]) -> T:
        if self._paths[key]:
            return read_description(self._paths[key], parse)
        return parse(self._texts[key], DESCRIPTIONS[key].name)

    def missing_descriptions(self) -> str:
        """The topics of the descriptions that have not come; empty when all have."""
        missing = [
            topic.name for key, topic in DESCRIPTIONS.items()
            if not self._paths[key] and key not in self._texts
        ]  # fmt: skip
        return ', '.join(missing)

    def plan(self) -> Program:
        """The measuring program of the gathered descriptions."""
        self._arm = self._description('arm', parse_arm)
        self._probe = self._description('probe', parse_probe)
        self._gauge = self._description('gauge', parse_gauge)
        self._joint_names = self._arm.joint_names
        planner = Planner(self._arm, self._probe, self._gauge, self._program_settings)
        return planner.program(self._placements, self._locations)

    def listen(self) -> None:
        """Take in joint states and probe readings from now on."""
        for kind, topic, take in (
            (JointState, JOINT_STATES, self._on_joints),
            (StylusDisplacements, PROBE_DISPLACEMENTS, self._on_reading),
        ):
            qos = qos_of(topic, best_effort=True)
            self.create_subscription(kind, topic.name, take, qos, raw=True)

    def missing_streams(self) -> str:
        """What of arm and probe has not shown itself yet; empty when both are there."""
        missing = []
        if not self._sampled:
            missing.append(f'{JOINT_STATES.name} with {", ".join(self._joint_names)}')
        if not self._commands.get_subscription_count():
            missing.append(f'an arm that listens to {JOINT_TRAJECTORY.name}')
        if not self._read:
            missing.append(PROBE_DISPLACEMENTS.name)
        return ', '.join(missing)

    def begin(self, program: Program) -> CaptureSession:
        """Open the bag and start the run."""
        recorder = Recorder(
            self.output, self._arm, self._probe, self._gauge, self._announce, time.time_ns()
        )
        run = MeasuringRun(self._arm, program, self._run_settings, time.monotonic())
        self._session = CaptureSession(
            run, Pairing(self._steady), recorder, self._arm.base_frame,
            self._command, time.monotonic, time.time_ns,
        )  # fmt: skip
        self.create_timer(TICK, self._tick)
        return self._session

    def stop_arm(self) -> None:
        """Let the arm forget the rest of its trajectory."""
        self._commands.publish(JointTrajectory(joint_names=list(self._joint_names)))

    def _tick(self) -> None:
        if self._session is None or self.failure is not None:
            return
        try:
            self._session.tick()
        except RunError as error:
            self.failure = error

    def _command(self, trajectory: Trajectory) -> None:
        self._commands.publish(joint_trajectory(self._joint_names, trajectory))

    def _announce(self, pose: bytes) -> None:
        self._poses.publish(pose)

    def _on_joints(self, raw: bytes) -> None:
        state = deserialize_message(raw, JointState)
        joints = joints_of(state, self._joint_names)
        if joints is None:
            return
        self._sampled = True
        if self._session is not None:
            self._session.take_joints(JointSample(stamp_of(state.header), joints), raw)

    def _on_reading(self, raw: bytes) -> None:
        self._read = True
        if self._session is None:
            return
        message = deserialize_message(raw, StylusDisplacements)
        first, second, third = message.status.tolist()
        reading = Reading(stamp_of(message.header), message.displacement, (first, second, third))
        self._session.take_reading(reading, raw)

    def wait_timeout(self) -> float:
        """Seconds to wait for arm and probe."""
        return self._wait_timeout


class _Stop:
    """Remembers a signal, so that nothing is cut off in the middle of a write."""

    def __init__(self) -> None:
        self.signal = 0
        signal.signal(signal.SIGINT, self._note)
        signal.signal(signal.SIGTERM, self._note)

    def _note(self, number: int, _: FrameType | None) -> None:
        self.signal = number


class Command:
    """One run of the command: waits, plans, measures, and says how it went."""

    def __init__(self, node: CaptureNode) -> None:
        self._node = node
        self._progress = Progress()
        self._stop = _Stop()
        self._executor = lean_executor()
        self._executor.add_node(node)

    def __call__(self) -> int:
        node = self._node
        if not self._wait_for(node.missing_descriptions):
            return self._interrupted('nothing recorded')
        program = node.plan()
        for location, sphere in program.unreached:
            self._progress.say(f'location {location}: sphere {sphere} is out of reach')
        node.listen()
        if not self._wait_for(node.missing_streams):
            return self._interrupted('nothing recorded')
        return self._measure(program)

    def _wait_for(self, missing: Callable[[], str]) -> bool:
        """Spin until nothing is missing; False when told to stop."""
        begin = told = time.monotonic()
        while what := missing():
            now = time.monotonic()
            if self._stop.signal:
                return False
            if now - begin > self._node.wait_timeout():
                raise RunError(f'waited {now - begin:.0f} s in vain for {what}')
            if now - told > REMINDER:
                told = now
                self._progress.say(f'waiting for {what}')
            self._executor.spin_once(timeout_sec=TICK)
        return True

    def _measure(self, program: Program) -> int:
        node, begin = self._node, time.monotonic()
        session = node.begin(program)
        with session.recorder:
            while not (session.finished or self._stop.signal or node.failure):
                self._executor.spin_once(timeout_sec=TICK)
                self._show(session)
            if not session.finished:
                node.stop_arm()
        seconds = time.monotonic() - begin
        summary = f'{node.output}: {session.tally.line()} in {seconds:.1f} s'
        if self._stop.signal:
            return self._interrupted(summary)
        if node.failure:
            raise RunError(f'{node.output}: {node.failure}')
        self._progress.say(summary)
        if not session.tally.taken:
            raise RunError(f'{node.output}: no pose was taken')
        return 0

    def _show(self, session: CaptureSession) -> None:
        tally, current, now = session.tally, session.run.current, time.monotonic()
        if current is not None:
            where = f'location {current.location}, sphere {current.sphere}'
            left = session.run.seconds_left(now)
            self._progress.show(tally.done, tally.planned, left, where, now)

    def _interrupted(self, summary: str) -> int:
        self._progress.say(f'stopped: {summary}')
        return INTERRUPTED + self._stop.signal


def _capture() -> int:
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rcl raises for arguments it cannot parse
        raise ParameterError(str(error).partition(', at ')[0]) from error
    node: Any = None
    try:
        node = CaptureNode()
        return Command(node)()
    except InvalidParameterTypeException as error:
        raise ParameterError(str(error)) from error
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Capture a measuring program into a bag; 2 when that cannot be done."""
    return run_command(_capture)


if __name__ == '__main__':
    sys.exit(main())
