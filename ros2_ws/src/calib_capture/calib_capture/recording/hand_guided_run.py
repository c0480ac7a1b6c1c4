# SPDX-License-Identifier: Apache-2.0
"""What becomes of a hand-guided arm: poses, spaced along its way. No graph."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import STYLI
from calib_model.labelling import NOWHERE, UNTOUCHED, SphereFinder
from calib_model.pairing import (
    REASONS,
    HandGuidedSettings,
    PairedReading,
    PairedReadings,
    SpacedPoses,
    reasons_in_words,
)

NO_SPHERE = 'no sphere known there'
NO_TOUCH = 'no sphere of that diameter touches the tips'
BLOCK = 4096  # readings that are held against all spheres at once


class HandGuidedPose(NamedTuple):
    """A pose on the move: `joints` (n,) in rad and `displacement` (3,) in m at `stamp` (ns)."""

    stamp: int
    location: int
    sphere: int
    joints: Array
    displacement: Array


class Held(NamedTuple):
    """The sphere that is being probed."""

    location: int
    sphere: int


@dataclass
class HandGuidedTally:
    """How it is going: every reading that came is `paired` or `refused`, or still to be settled."""

    planned: int = 0
    paired: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    spheres: Counter[Held] = field(default_factory=Counter)
    by_hand: int = 0  # poses that somebody asked for besides

    @property
    def taken(self) -> int:
        """How many poses there are."""
        return sum(self.spheres.values()) + self.by_hand

    @property
    def done(self) -> int:
        """As `taken`."""
        return self.taken

    @property
    def left(self) -> int:
        """How many are still planned."""
        return max(self.planned - self.taken, 0)

    @property
    def readings(self) -> int:
        """How many readings have been accounted for."""
        return self.paired + sum(self.refused.values())

    def refuse(self, reason: str, count: int) -> None:
        """Take note of so many refused readings."""
        if count:
            self.refused[reason] += count

    def line(self) -> str:
        """Counts in words."""
        why = reasons_in_words(self.refused)
        refused = f', {sum(self.refused.values())} refused ({why})' if why else ''
        return (
            f'{self.taken - self.by_hand} poses of {len(self.spheres)} spheres taken from '
            f'{self.readings} readings, {self.paired} paired{refused}'
        )


class HandGuidedRun:
    """Takes paired readings in time order and tells which of them are poses: `taken` so far."""

    def __init__(
        self, finder: SphereFinder, settings: HandGuidedSettings, planned: int = 0
    ) -> None:
        self.tally = HandGuidedTally(planned)
        self._finder = finder
        self._poses = SpacedPoses(settings)
        self.taken: list[HandGuidedPose] = []

    @property
    def current(self) -> Held | None:
        """The sphere in the probe, None in the air."""
        place = self._poses.place
        return None if place is None else Held(*self._finder.labels[place])

    def take(self, readings: Sequence[PairedReading]) -> list[HandGuidedPose]:
        """The poses that are certain now."""
        return self.take_many(PairedReadings.of(readings)) if readings else []

    def take_many(self, readings: PairedReadings) -> list[HandGuidedPose]:
        """As `take`, of columns."""
        poses: list[HandGuidedPose] = []
        for begin in range(0, len(readings.stamp), BLOCK):
            poses += self._take(readings.part(slice(begin, begin + BLOCK)))
        for pose in poses:
            self.tally.spheres[Held(pose.location, pose.sphere)] += 1
        self.taken += poses
        return poses

    def sphere_at(self, joints: Array) -> tuple[int, int]:
        """Location and sphere that a posture (n,) of a passive probe is at; zeros where none is
        known there."""
        row = int(self._finder.rows(joints[None], np.zeros((1, STYLI)))[0])
        return self._finder.labels[row] if row >= 0 else (0, 0)

    def start_over(self) -> None:
        """Take back what is not certain yet."""
        self._poses.start_over()

    def seconds_left(self, _: float) -> float:
        """Only the operator knows."""
        return math.nan

    def _take(self, readings: PairedReadings) -> list[HandGuidedPose]:
        good = readings.paired
        reasons = np.bincount(readings.reason[~good], minlength=len(REASONS))
        for reason, count in zip(REASONS, reasons.tolist(), strict=True):
            self.tally.refuse(reason, count)
        if not good.any():
            return []
        joints, displacement = readings.joints[good], readings.displacement[good]
        rows = self._finder.rows(joints, displacement)
        self.tally.refuse(NO_SPHERE, int((rows == NOWHERE).sum()))
        self.tally.refuse(NO_TOUCH, int((rows == UNTOUCHED).sum()))
        there = rows >= 0
        self.tally.paired += int(there.sum())
        taken = self._poses.take(
            readings.stamp[good][there], rows[there], joints[there], displacement[there]
        )
        return [
            HandGuidedPose(
                pose.stamp, *self._finder.labels[pose.place], pose.joints, pose.displacement
            )
            for pose in taken
        ]
