# SPDX-License-Identifier: Apache-2.0
"""What becomes of a hand-guided arm: poses, spaced along its way. No graph."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from calib_model.arrays import Array
from calib_model.labelling import NOWHERE, SphereFinder
from calib_model.pairing import NO_SPHERE, NO_TOUCH, HandGuidedSettings, PairedReading, travel
from calib_model.stamps import SECOND

APART = SECOND // 10  # ns between readings that belong to one contact


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

    @property
    def taken(self) -> int:
        """How many poses there are."""
        return sum(self.spheres.values())

    @property
    def done(self) -> int:
        """As `taken`."""
        return self.taken

    @property
    def readings(self) -> int:
        """How many readings have been accounted for."""
        return self.paired + sum(self.refused.values())

    def line(self) -> str:
        """Counts in words."""
        why = ', '.join(f'{count} {reason}' for reason, count in self.refused.most_common())
        refused = f', {sum(self.refused.values())} refused ({why})' if why else ''
        return (
            f'{self.taken} poses of {len(self.spheres)} spheres taken from {self.readings} '
            f'readings, {self.paired} paired{refused}'
        )


class HandGuidedRun:
    """Takes paired readings in time order and tells which of them are poses.

    `current` is the sphere in the probe, None in the air.
    """

    def __init__(
        self, finder: SphereFinder, settings: HandGuidedSettings, planned: int = 0
    ) -> None:
        self.tally = HandGuidedTally(planned)
        self.current: Held | None = None
        self._finder = finder
        self._settings = settings
        self._seated = round(settings.seated * SECOND)
        self._begin = self._last = -APART
        self._posture: Array | None = None  # of the last pose of this contact
        self._unsure: deque[HandGuidedPose] = deque()  # the contact may end too soon after these

    def take(self, readings: Sequence[PairedReading]) -> list[HandGuidedPose]:
        """The poses that are certain now."""
        good = [reading for reading in readings if not reading.reason]
        rows = iter(self._rows(good))
        poses: list[HandGuidedPose] = []
        for reading in readings:
            if reading.reason:
                self.tally.refused[reading.reason] += 1
                continue
            row = int(next(rows))
            if row < 0:
                self.tally.refused[NO_SPHERE if row == NOWHERE else NO_TOUCH] += 1
                continue
            self.tally.paired += 1
            poses += self._at(Held(*self._finder.labels[row]), reading)
        for pose in poses:
            self.tally.spheres[Held(pose.location, pose.sphere)] += 1
        return poses

    def start_over(self) -> None:
        """Take back what is not certain yet."""
        self.current, self._posture = None, None
        self._unsure.clear()

    def seconds_left(self, _: float) -> float:
        """Only the operator knows."""
        return math.nan

    def _rows(self, good: Sequence[PairedReading]) -> Sequence[int]:
        if not good:
            return ()
        joints = np.array([reading.joints for reading in good])
        displacement = np.array([reading.displacement for reading in good])
        rows: list[int] = self._finder.rows(joints, displacement).tolist()
        return rows

    def _at(self, held: Held, reading: PairedReading) -> list[HandGuidedPose]:
        """A reading on a sphere: the poses that it makes certain."""
        since = reading.stamp - self._last
        if held != self.current or not 0 < since <= APART:
            self.current, self._begin, self._posture = held, reading.stamp, None
            self._unsure.clear()
        self._last = reading.stamp
        sure = []
        while self._unsure and self._unsure[0].stamp + self._seated <= reading.stamp:
            sure.append(self._unsure.popleft())
        if reading.stamp - self._begin >= self._seated and self._far_enough(reading):
            assert reading.joints is not None
            self._posture = reading.joints
            self._unsure.append(
                HandGuidedPose(reading.stamp, *held, reading.joints, reading.displacement)
            )
        return sure

    def _far_enough(self, reading: PairedReading) -> bool:
        if self._posture is None or reading.joints is None:
            return True
        return travel(self._posture, reading.joints) >= self._settings.spacing
