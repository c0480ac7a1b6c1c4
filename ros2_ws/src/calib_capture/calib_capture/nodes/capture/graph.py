# SPDX-License-Identifier: Apache-2.0
"""The capture node's side of the graph: descriptions, streams, commands and poses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from calib_interfaces.msg import ProbingPose, StylusDisplacements
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_capture.checking import FirstSeconds
from calib_capture.default_files import refuse_other_arm
from calib_capture.measuring import MeasuringRun, RunError, SourceError
from calib_capture.motion import Trajectory
from calib_capture.nodes.arm_commander import ArmCommander, node_names
from calib_capture.nodes.capture.interventions import Interventions, TakeServices
from calib_capture.nodes.capture.parameters import CONTINUOUS, ParameterReader
from calib_capture.program import SIMULATED, Planner, Program
from calib_capture.recording import (
    HandGuidedRecord,
    HandGuidedRun,
    HandGuidedSession,
    Numbered,
    Origin,
    PoseTaker,
    ProgramSession,
    Publishers,
    Recorder,
    TakingSession,
    several,
)
from calib_model.bags import TEMPERATURE_NOTE, FileAccount
from calib_model.descriptions import (
    Standing,
    parse_arm,
    parse_gauge,
    parse_probe,
    parse_standing,
    read_description,
)
from calib_model.errors import ParameterError
from calib_model.instruments import ActiveProbe, PassiveProbe, refuse_misfit
from calib_model.labelling import SphereFinder
from calib_model.nodes import joints_of, qos_of, stamp_of
from calib_model.pairing import ClockEstimate, JointSample, Pairing, Reading
from calib_model.topics import (
    ARM_DESCRIPTION,
    CAPTURE_POSES,
    CAPTURE_UNDONE,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
    Topic,
)
from calib_model.transforms import RigidTransform

T = TypeVar('T')
TICK = 0.02  # s
#: a reading so many strokes long is no metres, and so many on end are no disturbance
MANY_STROKES, ODD_READINGS = 20.0, 10
AT_REST = 0.1  # s that an arm has stood still before it counts as stopped
SILENT = 2.0  # s without a message after which one is waited for
#: messages that wait while a disk is slow: readings, and all of a hand-guided arm, which does not
#: stop for us
DEEP = 5000
DESCRIPTIONS = {'arm': ARM_DESCRIPTION, 'probe': PROBE_DESCRIPTION, 'gauge': GAUGE_DESCRIPTION}
DESCRIBED_BY = {JOINT_STATES: ('arm',), PROBE_DISPLACEMENTS: ('probe', 'gauge')}


class CaptureNode(Node):
    """Runs a measuring program on an arm and a probe that it knows by their topics alone.

    Once no descriptions are missing `describe` reads them, `listen` takes in the streams;
    `begin` starts a session that then lives on messages and timer ticks, `end` leaves it.
    `watch`, when set, sees every joint sample and reading.
    """

    def __init__(self) -> None:
        super().__init__('capture')
        self._origins = {JOINT_STATES: Publishers(), PROBE_DISPLACEMENTS: Publishers()}
        self._texts: dict[str, str] = {}
        self._told: dict[str, float] = {}  # when each was described last, s
        self._heard = dict.fromkeys(self._origins, 0.0)
        self._changed: set[str] = set()  # what is described in another way than before
        self.asked = ParameterReader(self).read()
        self._session: ProgramSession | HandGuidedSession | TakingSession | None = None
        self._first: FirstSeconds | None = None
        self._early: list[tuple[JointSample | Reading, bytes, Origin]] = []
        self._sampled = self._read = False
        self._listening = False
        self._joint_names: tuple[str, ...] = ()
        self._simulated = False  # by the probe's own word, where a file describes it
        self.taught: dict[int, RigidTransform] = {}
        self.watch: Callable[[JointSample | Reading], None] | None = None
        self.failure: RunError | None = None
        self._odd = self._left_out = 0  # readings on end that no stylus makes, and all of them
        self.commanding = ArmCommander(self, self.asked.controller, self.asked.command)
        self.interventions = Interventions(self, self._program_session)
        self._poses = self.create_publisher(
            ProbingPose, CAPTURE_POSES.relative, qos_of(CAPTURE_POSES)
        )
        self._undone = self.create_publisher(
            ProbingPose, CAPTURE_UNDONE.relative, qos_of(CAPTURE_UNDONE)
        )
        self.taking = TakeServices(self, self._pose_taker)
        self._listen_for_descriptions()
        # of the wall's time, also where a bag's time rules: it stands still when nothing plays
        self.create_timer(TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _listen_for_descriptions(self) -> None:
        for key, topic in DESCRIPTIONS.items():
            if not self.asked.paths[key]:
                self._subscribe_description(key, topic)
        if self.asked.paths['probe']:  # the file says what it is, and the topic if it is real
            qos = qos_of(PROBE_DESCRIPTION)
            self.create_subscription(String, PROBE_DESCRIPTION.relative, self._note_simulated, qos)
        if self.asked.paths['arm']:  # how long it stands for a pose it may say all the same
            topic, self._arm_says = ARM_DESCRIPTION, ''

            def keep(message: String) -> None:
                self._arm_says = message.data

            self.create_subscription(String, topic.relative, keep, qos_of(topic))

    def _note_simulated(self, message: String) -> None:
        self._simulated = self._simulated or 'simulated: true' in message.data.splitlines()

    def _standing(self) -> Standing | None:
        """How long the arm is to stand for a pose, as its file or it itself says."""
        if not self.asked.paths['arm']:
            return parse_standing(self._texts['arm'], ARM_DESCRIPTION.name)
        said = parse_standing(self._arm_says, ARM_DESCRIPTION.name) if self._arm_says else None
        return read_description(self.asked.paths['arm'], parse_standing) or said

    def _subscribe_description(self, key: str, topic: Topic) -> None:
        def keep(message: String) -> None:
            self._told[key] = time.monotonic()
            if self._texts.setdefault(key, message.data) != message.data:
                self._changed.add(key)

        self.create_subscription(String, topic.relative, keep, qos_of(topic))

    def _description(self, key: str, parse: Callable[[str, str], T]) -> T:
        if self.asked.paths[key]:
            return read_description(self.asked.paths[key], parse)
        return parse(self._texts[key], DESCRIPTIONS[key].name)

    def missing_descriptions(self) -> str:
        """The topics of the descriptions that have not come; empty when all have."""
        missing = [
            topic.name
            for key, topic in DESCRIPTIONS.items()
            if not self.asked.paths[key] and key not in self._texts
        ]
        return ', '.join(missing)

    def describe(self) -> None:
        """Take arm, probe and gauge from the gathered descriptions."""
        self.arm = self._description('arm', parse_arm)
        self.probe = self._description('probe', parse_probe)
        self.gauge = self._description('gauge', parse_gauge)
        refuse_misfit(self.probe, self.gauge)
        self._joint_names = self.arm.joint_names

    def planner(self) -> Planner:
        """A planner for what was described.

        Raises:
            CalibrationError: there is none for such an arm, or the probe gives no readings.
        """
        if isinstance(self.probe, PassiveProbe):
            # its poses would all be where the program put them: perfect, and meaningless
            raise ParameterError(
                f'{self.probe.name} is a passive probe, which does not tell where a commanded arm '
                "really is: lead the arm by hand, with parameter 'mode' continuous"
            )
        self.refuse_assumed_places()
        return Planner(self.arm, self.probe, self.gauge, self.asked.program)

    def refuse_assumed_places(self) -> None:
        """Nothing, where the gauge's places were given or taught, or are the shipped arm's.

        Raises:
            ParameterError: they are the shipped arm's, and this is another one.
        """
        if self.asked.assumed and not self.taught:
            refuse_other_arm(self.arm.name, "parameter 'placements'")

    @property
    def _led(self) -> bool:
        return self.asked.mode == CONTINUOUS

    @property
    def placements(self) -> dict[int, RigidTransform]:
        """`T_base_gauge` by location; what was taught comes before what was given, and in place
        of the shipped example's."""
        if self.taught and self.asked.assumed:
            return dict(self.taught)
        return {**self.asked.placements, **self.taught}

    def listen(self) -> None:
        """Take in joint states and probe readings from now on."""
        if self._listening:
            return
        self._listening = True
        for kind, topic, take in (
            (JointState, JOINT_STATES, self._on_joints),
            (StylusDisplacements, PROBE_DISPLACEMENTS, self._on_reading),
        ):
            qos = qos_of(topic, best_effort=True)
            if self._led or topic is PROBE_DISPLACEMENTS:
                qos.depth = DEEP
            self.create_subscription(kind, topic.relative, Numbered(take), qos, raw=True)

    def silent(self) -> str:
        """The streams from which nothing comes any more, and since when; empty when all do."""
        now = time.monotonic()
        return ', '.join(
            f'{topic.name}, silent for {now - heard:.0f} s'
            for topic, heard in self._heard.items()
            if heard and now - heard > SILENT
        )

    def lost(self) -> str:
        """How many messages did not arrive since the session began, or were of no use; empty when
        all are there."""
        counts = {f'{topic.name} lost': origin.lost for topic, origin in self._origins.items()}
        counts[f'{PROBE_DISPLACEMENTS.name} longer than any stroke left out'] = self._left_out
        return ', '.join(f'{count} of {what}' for what, count in counts.items() if count)

    def check_origins(self) -> None:
        """Nothing, while each stream comes from one publisher, and each description stays.

        Raises:
            SourceError: one comes from several, or another description came; names the nodes.
        """
        for topic, origin in self._origins.items():
            if origin.origin is Origin.SEVERAL:
                origin.forget()  # the next goal finds out anew
                raise SourceError(several(topic.name, self._publishers_of(topic)))
        for key in sorted(self._changed):
            topic = DESCRIPTIONS[key]
            raise SourceError(
                f'{topic.name}: another {key} than before is described there, by '
                f'{self._publishers_of(topic)}; start the capture anew for it'
            )

    def _publishers_of(self, topic: Topic) -> str:
        return node_names(lambda: self.get_publishers_info_by_topic(topic.relative))

    def missing_streams(self) -> str:
        """What of arm and probe has not shown itself yet; empty when both are there."""
        missing = [joints] if (joints := self.missing_joints()) else []
        if not self._led and not self.commanding.heard():
            missing.append(f'an arm that listens to {self.commanding.where}')
        if not self._read:
            missing.append(PROBE_DISPLACEMENTS.name)
        return ', '.join(missing)

    def timed(self, program: Program) -> Program:
        """The program with how long it takes when it is commanded as was asked."""
        return self.asked.standing_as(self._standing()).run.timed(program, self.arm)

    def refuse_real_probe(self, program: Program) -> None:
        """Nothing, where a gauge that nobody carries is asked for in a simulation.

        Raises:
            ParameterError: the probe does not say that it is one.
        """
        several = len({plan.location for plan in program.spheres}) > 1
        simulated = self._simulated or self.probe.simulated
        if self.asked.between == SIMULATED and several and not simulated:
            raise ParameterError(
                f"parameter 'between_locations': {SIMULATED}, but the probe on "
                f'{PROBE_DESCRIPTION.name} does not say that it is simulated'
            )

    @property
    def awaits(self) -> int | None:
        """The location where the gauge is to be carried now."""
        session = self._program_session()
        return session.awaits if session is not None else None

    def begin(
        self, program: Program, earlier: Sequence[FileAccount] = (), at: int | None = None
    ) -> ProgramSession:
        """Open the bag, or go on with the files it has, and start the run; a gauge that is carried
        stands `at` a location."""
        self.failure = None
        self.asked = self.asked.standing_as(self._standing())
        self._count_anew()
        recorder = self._recorder(earlier)
        run = MeasuringRun(self.arm, program, self.asked.run, time.monotonic(), at)
        self._first = self._first_seconds(program)
        self._session = ProgramSession(
            run,
            Pairing(self.asked.steady),
            recorder,
            self.arm.base_frame,
            self._command,
            time.monotonic,
            time.time_ns,
            ClockEstimate(self.arm, self.probe, self.gauge),
        )
        return self._session

    def _first_seconds(self, program: Program) -> FirstSeconds | None:
        if not (self.asked.check and isinstance(self.probe, ActiveProbe)):
            return None
        gauge = self.gauge
        places = [
            self.placements[plan.location].apply(gauge.center(plan.sphere))
            for plan in program.spheres
        ]
        return FirstSeconds(self.arm, self.probe, gauge, np.array(places))

    def _objects(self, message: JointSample | Reading) -> bool:
        """Whether what was heard first speaks against all that is to come."""
        if self._first is None:
            return False
        self._first.see(message, time.monotonic())
        if isinstance(self._session, ProgramSession):
            self._first.refused(self._session.tally.taken, self._session.tally.refused)
        if not self._first.objection:
            return False
        self.failure = self.failure or RunError(self._first.objection)
        self._first = None
        return True

    def _recorder(self, earlier: Sequence[FileAccount]) -> Recorder:
        asked = self.asked
        with asked.confined():
            recorder = Recorder(
                asked.output,
                self.arm,
                replace(self.probe, simulated=self.probe.simulated or self._simulated),
                self.gauge,
                self._announce,
                time.time_ns(),
                asked.steady,
                earlier,
            )
        if asked.temperature is not None:
            recorder.note(TEMPERATURE_NOTE, asked.temperature.content())
        return recorder

    def begin_hand_guided(
        self, earlier: Sequence[FileAccount], noted: HandGuidedRecord
    ) -> HandGuidedSession:
        """Open the bag, or go on with the files it has, and take in a hand-guided arm.

        What has come of its streams until now is the first of it.
        """
        self.failure = None
        if self.asked.serve:  # else what came before is part of it
            self._count_anew()
        asked, now = self.asked, time.monotonic
        recorder = self._recorder(earlier)
        finder = SphereFinder(self.arm, self.probe, self.gauge, noted.placements, noted.spheres)
        planned = len(finder.labels) * asked.program.poses_per_sphere
        run, taker = HandGuidedRun(finder, noted.settings, planned), None
        if isinstance(self.probe, PassiveProbe):
            taker = PoseTaker(
                self.arm,
                self.probe,
                recorder,
                self._undone.publish,
                now,
                time.time_ns,
                run.sphere_at,
            )
        session = HandGuidedSession(
            run,
            ClockEstimate(self.arm, self.probe, self.gauge),
            recorder,
            noted,
            self.arm.base_frame,
            now,
            time.time_ns,
            asked.silence,
            asked.correct_clock,
            taker,
        )
        self._session = session
        early, self._early = self._early, []
        for message, raw, origin in early:
            self._pass_on(message, raw, origin)
        return session

    def missing_joints(self) -> str:
        """The joint states, until one has come."""
        names = ', '.join(self._joint_names)
        return '' if self._sampled else f'{JOINT_STATES.name} with {names}'

    def without_readings(self) -> bool:
        """Whether the probe is a ball or a seat of which no node tells anything."""
        silent = not self._read and not self.count_publishers(PROBE_DISPLACEMENTS.relative)
        return silent and isinstance(self.probe, PassiveProbe)

    def begin_taking(self, earlier: Sequence[FileAccount]) -> TakingSession:
        """Open the bag, or go on with the files it has, to take poses when asked."""
        assert isinstance(self.probe, PassiveProbe)
        self.failure = None
        self._count_anew()
        self._early.clear()
        recorder, now = self._recorder(earlier), time.monotonic
        taker = PoseTaker(self.arm, self.probe, recorder, self._undone.publish, now, time.time_ns)
        session = TakingSession(taker, recorder, now, time.time_ns, self.asked.silence)
        self._session = session
        return session

    def _pose_taker(self) -> PoseTaker | None:
        session = self._session
        return session.taker if isinstance(session, TakingSession | HandGuidedSession) else None

    def _count_anew(self) -> None:
        self._odd = self._left_out = 0
        for origin in self._origins.values():
            origin.lost = 0

    def end(self) -> None:
        """Leave the session and the arm: what comes from now on is none of its business."""
        self._session = self._first = None
        self.commanding.leave()

    def _program_session(self) -> ProgramSession | None:
        return self._session if isinstance(self._session, ProgramSession) else None

    def stop_arm(self) -> None:
        """Bring the arm to rest on its way, within its limits; `stopping` until it is."""
        if isinstance(self._session, ProgramSession):
            self._session.halt()

    @property
    def stopping(self) -> bool:
        """Whether an arm that is to stop still moves."""
        if not isinstance(self._session, ProgramSession):
            return False
        return self._session.halting or self._session.run.where.stands[1] < AT_REST

    def where_it_stands(self) -> str:
        """The joints, in words; empty where nobody commanded the arm."""
        session = self._program_session()
        here = session.run.where.stands[0] if session is not None else None
        if here is None:
            return ''
        joints = ', '.join(
            f'{name} {value:.4f}' for name, value in zip(self._joint_names, here, strict=True)
        )
        return f'the arm stands at {joints} rad'

    def _tick(self) -> None:
        if self._session is None:
            return
        if self.failure is not None:  # only to bring the arm to rest
            if isinstance(self._session, ProgramSession):
                self._session.go_on_halting()
            return
        try:
            self.check_origins()
            if self.commanding.problem:
                raise RunError(self.commanding.problem)
            self._session.tick()
        except RunError as error:
            self.failure = error

    def _command(self, trajectory: Trajectory) -> None:
        sent = self.commanding.send(self._joint_names, trajectory)
        if (session := self._program_session()) is not None:
            session.recorder.raw(self.commanding.topic, sent, time.time_ns())

    def _announce(self, pose: bytes) -> None:
        self._poses.publish(pose)

    def _origin(self, topic: Topic, number: int | None) -> Origin:
        """Of the message of that number; unsure while a publisher that was started anew, perhaps
        with something else, may still have to describe it."""
        now = time.monotonic()
        origin = self._origins[topic].see(number, now)
        left = self._origins[topic].left(now)
        told = [self._told[key] for key in DESCRIBED_BY[topic] if key in self._told]
        if origin is Origin.ONE and left is not None and any(when < left for when in told):
            return Origin.UNSURE
        return origin

    def _on_joints(self, raw: bytes, number: int | None) -> None:
        state = deserialize_message(raw, JointState)
        joints = joints_of(state, self._joint_names)
        if joints is None:
            self._origins[JOINT_STATES].pass_by(number)
            return
        origin = self._origin(JOINT_STATES, number)
        sample = JointSample(stamp_of(state.header), joints)
        self._sampled, self._heard[JOINT_STATES] = True, time.monotonic()
        if self.watch is not None and origin is Origin.ONE:
            self.watch(sample)
        if self._session is not None:
            self._pass_on(sample, raw, origin)
        elif self._led and not self.asked.serve:
            self._early.append((sample, raw, origin))

    def _on_reading(self, raw: bytes, number: int | None) -> None:
        self._read, self._heard[PROBE_DISPLACEMENTS] = True, time.monotonic()
        origin = self._origin(PROBE_DISPLACEMENTS, number)
        if self._session is None and self.watch is None and not self._led:
            return
        message = deserialize_message(raw, StylusDisplacements)
        first, second, third = message.status.tolist()
        reading = Reading(stamp_of(message.header), message.displacement, (first, second, third))
        if self.watch is not None and origin is Origin.ONE:
            self.watch(reading)
        if self._session is not None:
            self._pass_on(reading, raw, origin)
        elif self._led and not self.asked.serve:
            self._early.append((reading, raw, origin))

    def _pass_on(self, message: JointSample | Reading, raw: bytes, origin: Origin) -> None:
        assert self._session is not None
        if self._changed:  # until the next tick sees it: this may be of what nobody described to us
            return
        if origin is not Origin.ONE:
            if self._first is not None:
                self._first.start_over()
            of_arm = isinstance(message, JointSample)
            self._session.start_over(JOINT_STATES if of_arm else PROBE_DISPLACEMENTS)
        elif isinstance(message, Reading) and not self._possible(message) or self._objects(message):
            pass
        elif isinstance(message, JointSample):
            self._session.take_joints(message, raw)
        else:
            self._session.take_reading(message, raw)

    def _possible(self, reading: Reading) -> bool:
        """Whether a stylus can have made it: no pose is taken of what is many strokes long, and
        where reading upon reading is, of a driver in mm, say, the run ends."""
        if not isinstance(self.probe, ActiveProbe):
            return True
        size, stroke = max(map(abs, reading.displacement)), np.abs(self.probe.stroke).max()
        if size <= MANY_STROKES * stroke:
            self._odd = 0
            return True
        self._odd += 1
        self._left_out += not self._led  # a led arm's record is whole
        if self._odd == ODD_READINGS:
            self.failure = RunError(
                f'readings of {size:g} m on {PROBE_DISPLACEMENTS.name}, where a stylus moves by '
                f'{stroke:g} m at most: is its driver in mm?'
            )
        return self._led
