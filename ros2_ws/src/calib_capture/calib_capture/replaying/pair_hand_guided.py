# SPDX-License-Identifier: Apache-2.0
"""Pairing on the move done again from the raw topics of a bag."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_capture.recording import (
    HandGuidedPose,
    HandGuidedRecord,
    HandGuidedRun,
    HandGuidedTally,
    clock_line,
)
from calib_capture.replaying.raw_recording import read_recording
from calib_model.errors import BagError
from calib_model.labelling import SphereFinder
from calib_model.measurement import Measurement, ProbingSet
from calib_model.pairing import BRIDGED, OUT_OF_ORDER, ClockOffset, Gaps, paired_parts
from calib_model.progress import Progress
from calib_model.stamps import SECOND


@dataclass(frozen=True)
class PairedHandGuided:
    """What came of pairing hand-guided streams anew; readings were shifted by `shift` ns."""

    measured: Measurement
    tally: HandGuidedTally
    late_joints: int
    clock: ClockOffset | None
    shift: int
    bridged: int = 0  # readings paired across missing joint states
    remarks: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The counts in words."""
        late = [f'{self.late_joints} joint states out of order'] if self.late_joints else []
        bridged = [BRIDGED.format(self.bridged)] if self.bridged else []
        return [
            *self.remarks,
            self.tally.line(),
            *late,
            *bridged,
            clock_line(self.clock, self.shift),
        ]


def paired_hand_guided(
    path: Path,
    note: HandGuidedRecord,
    correct_clock: bool = False,
    progress: Progress | None = None,
    stamps: str = 'auto',
) -> PairedHandGuided:
    """The poses of a hand-guided arm's bag, in time order, paired as `note` says.

    With `correct_clock` readings are paired at their stamps in the joints' clock, as far as the
    streams tell the offset; otherwise by the note's own shift. Poses keep the readings' stamps.
    `stamps` says which count, as `read_raw` does.

    Raises:
        BagError: no bag, a topic missing or not readable, or no pose comes of it.
        DescriptionError: a description in the bag cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    raw = read_recording(path, progress, stamps)
    clock = raw.clock()
    shift = note.shift
    if correct_clock:
        shift = round(clock.seconds * SECOND) if clock is not None else 0
    finder = SphereFinder(raw.arm, raw.probe, raw.gauge, note.placements, note.spheres)
    run = HandGuidedRun(finder, note.settings)
    poses, gaps, late_joints = [], Gaps(), 0
    for stretch in raw.streams.stretches():
        streams = stretch.ordered(note.settings.lateness)
        run.tally.refuse(OUT_OF_ORDER, streams.late_readings)
        for paired in paired_parts(streams, note.settings.max_gap, shift):
            poses += run.take_many(paired)
            gaps.see(paired.gap)
        late_joints += streams.late_joints
    poses.sort(key=lambda pose: pose.stamp)
    if not poses:
        raise BagError(f'{path}: no pose comes of it: {run.tally.line()}')
    measured = Measurement(raw.arm, raw.probe, raw.gauge, _probing_set(poses), str(path)).checked()
    return PairedHandGuided(
        measured, run.tally, late_joints, clock, shift, gaps.bridged, raw.remarks
    )


def _probing_set(poses: list[HandGuidedPose]) -> ProbingSet:
    return ProbingSet(
        np.array([pose.location for pose in poses], dtype=np.int64),
        np.array([pose.sphere for pose in poses], dtype=np.int64),
        np.array([pose.joints for pose in poses]),
        np.array([pose.displacement for pose in poses]),
        np.array([pose.stamp for pose in poses], dtype=np.int64),
        np.ones(len(poses), dtype=np.int64),
    )
