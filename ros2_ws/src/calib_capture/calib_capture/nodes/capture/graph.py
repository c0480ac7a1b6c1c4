# SPDX-License-Identifier: Apache-2.0
"""The capture node's side of the graph: a session between its streams and its commands."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from calib_interfaces.msg import ProbingPose
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher

from calib_capture.checking import FirstSeconds
from calib_capture.default_files import refuse_other_arm
from calib_capture.measuring import RunError
from calib_capture.motion import Trajectory
from calib_capture.nodes.arm_commander import ArmCommander
from calib_capture.nodes.capture.descriptions import Descriptions
from calib_capture.nodes.capture.interventions import Interventions, TakeServices
from calib_capture.nodes.capture.parameters import CONTINUOUS, ParameterReader
from calib_capture.nodes.capture.sessions import Opening, Outgoing
from calib_capture.nodes.capture.streams import Streams
from calib_capture.program import Program
from calib_capture.recording import (
    Admission,
    HandGuidedRecord,
    HandGuidedSession,
    PoseTaker,
    ProgramSession,
    Session,
    TakingSession,
)
from calib_model.bags import FileAccount
from calib_model.instruments import ActiveProbe, Arm, Gauge, PassiveProbe, Probe
from calib_model.nodes import qos_of
from calib_model.topics import (
    CAPTURE_POSES,
    CAPTURE_UNDONE,
    PROBE_DISPLACEMENTS,
    Topic,
)
from calib_model.transforms import RigidTransform

TICK = 0.02  # s


class CaptureNode(Node):
    """Runs a measuring program on an arm and a probe that it knows by their topics alone.

    Once no descriptions are missing `describe` reads them, `listen` takes in the streams; a
    `begin` starts a session that then lives on messages and timer ticks, `end` leaves it.
    `failure` is why a session has to end.
    """

    arm: Arm
    probe: Probe
    gauge: Gauge

    def __init__(self) -> None:
        super().__init__('capture')
        self.asked = ParameterReader(self).read()
        self._session: Session | None = None
        self._admission: Admission | None = None
        self.taught: dict[int, RigidTransform] = {}
        self.failure: RunError | None = None
        self.descriptions = Descriptions(self, self.asked.paths)
        keeps = self.led and not self.asked.serve
        self.streams = Streams(self, self.descriptions, keeps)
        self.commanding = ArmCommander(self, self.asked.controller, self.asked.command)
        self.interventions = Interventions(self, self._program_session)
        self._outgoing = Outgoing(
            self._publisher(CAPTURE_POSES).publish,
            self._publisher(CAPTURE_UNDONE).publish,
            self._command,
        )
        self.taking = TakeServices(self, self._pose_taker)
        # of the wall's time, also where a bag's time rules: it stands still when nothing plays
        self.create_timer(TICK, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _publisher(self, topic: Topic) -> Publisher:
        return self.create_publisher(ProbingPose, topic.relative, qos_of(topic))

    def describe(self) -> None:
        """Take arm, probe and gauge from the gathered descriptions."""
        self.arm, self.probe, self.gauge = self.descriptions.read()
        self.streams.of_joints(self.arm.joint_names)

    def listen(self) -> None:
        """Take in joint states and probe readings from now on."""
        self.streams.listen(self.led)

    @property
    def led(self) -> bool:
        """Whether the arm is led by hand."""
        return self.asked.mode == CONTINUOUS

    @property
    def placements(self) -> dict[int, RigidTransform]:
        """`T_base_gauge` by location; what was taught comes before what was given, and in place
        of the shipped example's."""
        if self.taught and self.asked.assumed:
            return dict(self.taught)
        return {**self.asked.placements, **self.taught}

    def refuse_assumed_places(self) -> None:
        """Nothing, where the gauge's places were given or taught, or are the shipped arm's.

        Raises:
            ParameterError: they are the shipped arm's, and this is another one.
        """
        if self.asked.assumed and not self.taught:
            refuse_other_arm(self.arm.name, "parameter 'placements'")

    def refuse_strangers(self) -> None:
        """Nothing, while each stream comes from one publisher, and each description stays.

        Raises:
            SourceError: one comes from several, or another description came; names the nodes.
        """
        self.streams.refuse_several()
        self.descriptions.refuse_change(self.streams.publishers_of)

    def missing_streams(self) -> str:
        """What of arm and probe has not shown itself yet; empty when both are there."""
        missing = [joints] if (joints := self.streams.missing_joints()) else []
        if not self.led and not self.commanding.heard():
            missing.append(f'an arm that listens to {self.commanding.where}')
        if not self.streams.has_readings:
            missing.append(PROBE_DISPLACEMENTS.name)
        return ', '.join(missing)

    def without_readings(self) -> bool:
        """Whether the probe is a ball or a seat of which no node tells anything."""
        if self.streams.has_readings or self.count_publishers(PROBE_DISPLACEMENTS.relative):
            return False
        return isinstance(self.probe, PassiveProbe)

    @property
    def known_probe(self) -> Probe:
        """The probe with what it says of itself on its topic, where a file describes it."""
        return replace(self.probe, simulated=self.probe.simulated or self.descriptions.simulated)

    def begin(
        self, program: Program, earlier: Sequence[FileAccount] = (), at: int | None = None
    ) -> ProgramSession:
        """Open the bag, or go on with the files it has, and start the run; a gauge that is carried
        stands `at` a location."""
        self.asked = self.asked.standing_as(self.descriptions.standing())
        self.streams.count_anew()
        session = self._opening(earlier).program(program, at)
        self._admit(session, self._first_seconds(program))
        return session

    def begin_hand_guided(
        self, earlier: Sequence[FileAccount], noted: HandGuidedRecord
    ) -> HandGuidedSession:
        """Open the bag, or go on with the files it has, and take in a hand-guided arm.

        What has come of its streams until now is the first of it.
        """
        if self.asked.serve:  # else what came before is part of it
            self.streams.count_anew()
        session = self._opening(earlier).hand_guided(noted)
        self._admit(session)
        return session

    def begin_taking(self, earlier: Sequence[FileAccount]) -> TakingSession:
        """Open the bag, or go on with the files it has, to take poses when asked."""
        self.streams.count_anew()
        self.streams.forget()
        session = self._opening(earlier).taking()
        self._admit(session)
        return session

    def _opening(self, earlier: Sequence[FileAccount]) -> Opening:
        self.failure = None
        known = self.known_probe
        return Opening(self.asked, self.arm, known, self.gauge, earlier, self._outgoing)

    def _admit(self, session: Session, first: FirstSeconds | None = None) -> None:
        self._session = session
        self._admission = Admission(session, self.probe, self._fail, first)
        self.streams.receive(self._admission.take)

    def _first_seconds(self, program: Program) -> FirstSeconds | None:
        if not (self.asked.check and isinstance(self.probe, ActiveProbe)):
            return None
        places = [
            self.placements[plan.location].apply(self.gauge.center(plan.sphere))
            for plan in program.spheres
        ]
        poses = np.array([pose.joints for pose in program.poses]).reshape(-1, self.arm.n)
        spread = self.asked.steady.max_spread
        return FirstSeconds(self.arm, self.probe, self.gauge, np.array(places), poses, spread)

    def _fail(self, error: RunError) -> None:
        self.failure = self.failure or error

    def end(self) -> None:
        """Leave the session and the arm: what comes from now on is none of its business."""
        self._session = None
        self.streams.leave()
        self.commanding.leave()

    def lost(self) -> str:
        """How many messages did not arrive since the session began, or were of no use; empty when
        all are there."""
        counts = {f'{name} lost': count for name, count in self.streams.lost().items()}
        left_out = self._admission.left_out if self._admission is not None else 0
        counts[f'{PROBE_DISPLACEMENTS.name} longer than any stroke left out'] = left_out
        return ', '.join(f'{count} of {what}' for what, count in counts.items() if count)

    def _program_session(self) -> ProgramSession | None:
        return self._session if isinstance(self._session, ProgramSession) else None

    def _pose_taker(self) -> PoseTaker | None:
        session = self._session
        return session.taker if isinstance(session, TakingSession | HandGuidedSession) else None

    @property
    def awaits(self) -> int | None:
        """The location where the gauge is to be carried now."""
        session = self._program_session()
        return session.awaits if session is not None else None

    def _tick(self) -> None:
        if self._session is None:
            return
        if self.failure is not None:  # only to bring the arm to rest
            if isinstance(self._session, ProgramSession):
                self._session.go_on_halting()
            return
        try:
            self.refuse_strangers()
            if self.commanding.problem:
                raise RunError(self.commanding.problem)
            self._session.tick()
        except RunError as error:
            self.failure = error

    def _command(self, trajectory: Trajectory) -> None:
        sent = self.commanding.send(self.arm.joint_names, trajectory)
        if (session := self._program_session()) is not None:
            session.recorder.raw(self.commanding.topic, sent, time.time_ns())
