# SPDX-License-Identifier: Apache-2.0
"""A session of each kind, with the bag that it writes or goes on with."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from calib_capture.checking import small_turns_at
from calib_capture.measuring import MeasuringRun
from calib_capture.motion import Trajectory
from calib_capture.nodes.capture.parameters import CaptureParameters
from calib_capture.program import PlannedPose, Program
from calib_capture.recording import (
    HandGuidedRecord,
    HandGuidedRun,
    HandGuidedSession,
    PoseTaker,
    ProgramSession,
    Recorder,
    TakingSession,
)
from calib_model.arrays import Array
from calib_model.bags import TEMPERATURE_NOTE, FileAccount
from calib_model.instruments import ActiveProbe, Arm, Gauge, PassiveProbe, Probe
from calib_model.labelling import SphereFinder
from calib_model.pairing import ClockEstimate, Pairing


@dataclass(frozen=True)
class Outgoing:
    """What takes a session's CDR bytes of each pose that is safe, of each that was taken back, and
    its commands."""

    pose: Callable[[bytes], None]
    undone: Callable[[bytes], None]
    command: Callable[[Trajectory], None]


@dataclass(frozen=True)
class Opening:
    """Opens the bag that is `asked` for, or goes on with its files `earlier`, and begins a session
    of an arm, a probe and a gauge.

    All of it raises BagError where the bag cannot be written.
    """

    asked: CaptureParameters
    arm: Arm
    probe: Probe
    gauge: Gauge
    earlier: Sequence[FileAccount]
    outgoing: Outgoing

    def program(self, program: Program, at: int | None) -> ProgramSession:
        """A run of a program; a gauge that is carried stands `at` a location."""
        recorder = self._recorder()
        return ProgramSession(
            MeasuringRun(self.arm, program, self.asked.run, time.monotonic(), at, self._turns()),
            Pairing(self.asked.steady),
            recorder,
            self.arm.base_frame,
            self.outgoing.command,
            time.monotonic,
            time.time_ns,
            ClockEstimate(self.arm, self.probe, self.gauge),
        )

    def _turns(self) -> Callable[[PlannedPose], Array] | None:
        """Small motions at the first poses, for the check to tell signs and clocks by."""
        probe, diameter = self.probe, self.gauge.sphere_diameter
        if not (self.asked.check and isinstance(probe, ActiveProbe)):
            return None

        def turns(pose: PlannedPose) -> Array:
            displacement = probe.displacements(pose.p_probe_sphere[None], diameter)[0]
            return small_turns_at(self.arm, probe, pose.joints, displacement)

        return turns

    def hand_guided(self, noted: HandGuidedRecord) -> HandGuidedSession:
        """A hand-guided arm, whose poses are taken along the way; those of a passive probe by hand
        besides."""
        asked, recorder = self.asked, self._recorder()
        finder = SphereFinder(self.arm, self.probe, self.gauge, noted.placements, noted.spheres)
        planned = len(finder.labels) * asked.program.poses_per_sphere
        run, taker = HandGuidedRun(finder, noted.settings, planned), None
        if isinstance(self.probe, PassiveProbe):
            taker = PoseTaker(
                self.arm,
                self.probe,
                recorder,
                self.outgoing.undone,
                time.monotonic,
                time.time_ns,
                run.sphere_at,
            )
        return HandGuidedSession(
            run,
            ClockEstimate(self.arm, self.probe, self.gauge),
            recorder,
            noted,
            self.arm.base_frame,
            time.monotonic,
            time.time_ns,
            asked.silence,
            asked.correct_clock,
            taker,
        )

    def taking(self) -> TakingSession:
        """A hand-guided arm whose poses are all taken by hand."""
        assert isinstance(self.probe, PassiveProbe)
        recorder, now = self._recorder(), time.monotonic
        taker = PoseTaker(self.arm, self.probe, recorder, self.outgoing.undone, now, time.time_ns)
        return TakingSession(taker, recorder, now, time.time_ns, self.asked.silence)

    def _recorder(self) -> Recorder:
        asked = self.asked
        with asked.confined():
            recorder = Recorder(
                asked.output,
                self.arm,
                self.probe,
                self.gauge,
                self.outgoing.pose,
                time.time_ns(),
                asked.steady,
                self.earlier,
            )
        if asked.temperature is not None:
            recorder.note(TEMPERATURE_NOTE, asked.temperature.content())
        return recorder
