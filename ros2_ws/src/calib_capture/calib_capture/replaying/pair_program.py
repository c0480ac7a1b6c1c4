# SPDX-License-Identifier: Apache-2.0
"""Pairing done again from the raw topics of a bag."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from calib_capture.replaying.raw_recording import RawRecording, read_recording
from calib_model.errors import BagError
from calib_model.labelling import SphereFinder
from calib_model.measurement import Measurement, ProbingSet
from calib_model.pairing import (
    ClockOffset,
    Refusal,
    SteadyPose,
    SteadySettings,
    reasons_in_words,
    recorded_outcomes,
)
from calib_model.progress import Progress
from calib_model.stamps import SECOND
from calib_model.topics import CAPTURE_POSES
from calib_model.transforms import RigidTransform

Label = tuple[int, int]  # location and sphere
SAME_POSTURE = 2e-3  # rad: what a run takes for the planned pose
SAME_STOP = 0.5  # s beyond the window: other settings find another instant of the same stop


@dataclass
class PairedProgram:
    """What came of pairing anew.

    `recorded` poses were in the bag, of which `missed` have no pose now. `unknown` counts stops
    that were paired and belong to no sphere, `refused` stops by their reason.
    """

    measured: Measurement
    recorded: int
    missed: int
    unknown: int
    refused: Counter[str] = field(default_factory=Counter)
    too_late: int = 0
    clock: ClockOffset | None = None
    remarks: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The counts in words."""
        lines = list(self.remarks)
        if self.recorded:
            lines.append(f'{self.recorded} poses were recorded, {self.missed} have no pose now')
        if self.unknown:
            lines.append(f'{self.unknown} stops belong to no sphere')
        if self.refused:
            why = reasons_in_words(self.refused)
            lines.append(f'{sum(self.refused.values())} stops refused: {why}')
        if self.clock is not None:
            lines.append(self.clock.line())
        if self.too_late:
            lines.append(f'{self.too_late} messages came too late for their place')
        return lines


def paired_program(
    path: Path,
    settings: SteadySettings,
    placements: Mapping[int, RigidTransform] | None = None,
    correct_clock: bool = False,
    progress: Progress | None = None,
    stamps: str = 'auto',
) -> PairedProgram:
    """The poses of a bag paired anew with `settings`, in time order.

    The recorded poses say which sphere each belongs to; with `placements` (`T_base_gauge`) the
    nominal centres of the spheres do. With `correct_clock` readings are paired at their stamps in
    the joints' clock, as far as the streams tell the offset; poses keep the readings' stamps.
    `progress` hears how far it is. `stamps` says which count, as `read_raw` does.

    Raises:
        BagError: no bag, a topic missing or not readable, or no pose comes of it.
        DescriptionError: a description in the bag cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    raw = read_recording(path, progress, stamps)
    if raw.poses is None and placements is None:
        raise BagError(
            f'{path}: no {CAPTURE_POSES.name} to say which spheres were probed, '
            'say where the gauge stood (--placements)'
        )
    clock = raw.clock()
    shift = round(clock.seconds * SECOND) if clock is not None and correct_clock else 0
    shifted = replace(raw.streams, reading_stamp=raw.streams.reading_stamp + shift)
    outcomes, too_late = recorded_outcomes(shifted, settings)
    steady = sorted(
        (
            replace(each, stamp=each.stamp - shift)
            for each in outcomes
            if isinstance(each, SteadyPose)
        ),
        key=lambda each: each.stamp,
    )
    recorded = 0
    if placements is not None:
        labels = _nominal(raw, placements, steady)
    else:
        assert raw.poses is not None
        labels, recorded = _Recorded(raw.poses, settings).labels(steady), len(raw.poses)
    known = [(each, label) for each, label in zip(steady, labels, strict=True) if label]
    if not known:
        hint = 'led by hand? say --mode continuous'
        raise BagError(f'{path}: no pose comes of its {len(outcomes)} stops ({hint})')
    measured = Measurement(raw.arm, raw.probe, raw.gauge, _probing_set(known), str(path)).checked()
    refused = Counter(each.reason.value for each in outcomes if isinstance(each, Refusal))
    missed = recorded - len(known) if placements is None else 0
    unknown = len(steady) - len(known)
    return PairedProgram(measured, recorded, missed, unknown, refused, too_late, clock, raw.remarks)


def _nominal(
    raw: RawRecording, placements: Mapping[int, RigidTransform], steady: list[SteadyPose]
) -> list[Label | None]:
    """The sphere of each stop by where the nominal arm sees it; None where none is near."""
    if not steady:
        return []
    finder = SphereFinder(raw.arm, raw.probe, raw.gauge, placements)
    rows = finder.rows(
        np.array([pose.joints for pose in steady]),
        np.array([pose.displacement for pose in steady]),
    )
    return [finder.labels[row] if row >= 0 else None for row in rows]


def _probing_set(known: list[tuple[SteadyPose, Label]]) -> ProbingSet:
    return ProbingSet(
        np.array([label[0] for _, label in known], dtype=np.int64),
        np.array([label[1] for _, label in known], dtype=np.int64),
        np.array([pose.joints for pose, _ in known]),
        np.array([pose.displacement for pose, _ in known]),
        np.array([pose.stamp for pose, _ in known], dtype=np.int64),
        np.array([pose.readings for pose, _ in known], dtype=np.int64),
    )


class _Recorded:
    """Knows the sphere of a stop from the pose that was recorded of it."""

    def __init__(self, poses: ProbingSet, settings: SteadySettings) -> None:
        order = np.argsort(poses.stamp, kind='stable')
        self._stamp, self._joints = poses.stamp[order], poses.joints[order]
        self._label_of = list(
            zip(poses.location[order].tolist(), poses.sphere[order].tolist(), strict=True)
        )
        self._reach = round((settings.settle + settings.dwell + SAME_STOP) * SECOND)
        self._free = np.ones(len(order), dtype=np.bool_)

    def labels(self, steady: list[SteadyPose]) -> list[Label | None]:
        """Location and sphere of each; None where no recorded pose is of the same stop."""
        return [self._label(pose) for pose in steady]

    def _label(self, pose: SteadyPose) -> Label | None:
        if self._joints.shape[1] != len(pose.joints):
            return None
        begin = np.searchsorted(self._stamp, pose.stamp - self._reach)
        end = np.searchsorted(self._stamp, pose.stamp + self._reach, side='right')
        rows = np.arange(begin, end)
        off = np.abs(self._joints[rows] - pose.joints).max(axis=1, initial=0.0)
        rows = rows[self._free[rows] & (off <= SAME_POSTURE)]
        if not len(rows):
            return None
        best = int(rows[np.abs(self._stamp[rows] - pose.stamp).argmin()])
        self._free[best] = False
        return self._label_of[best]
