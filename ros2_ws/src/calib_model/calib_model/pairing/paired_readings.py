# SPDX-License-Identifier: Apache-2.0
"""Readings of a hand-guided arm with the joints at their stamps, or a reason why there are none.

Live pairing calls this for the few readings that have become due, all else for whole recordings.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.pairing.interpolation import interpolated, states_around
from calib_model.pairing.readings import GRAVEST, Reason, objections
from calib_model.pairing.streams import RawStreams, Rows
from calib_model.stamps import SECOND

STEP = SECOND // 10_000  # ns to which gaps between joint states are counted
PART = 100_000  # readings that are paired together
WIDE = 1.5  # of the usual gap: a joint state is missing there
BRIDGED = '{} readings paired across missing joint states'
NO_JOINTS = Reason.JOINTS_MISSING.value
OUT_OF_ORDER = 'out of order'
UNSURE = 'publisher started anew'
PAIRED = ''
#: what `reason` counts from; the first of them are those of `objections`
REASONS = (*(reason.value for reason in GRAVEST), PAIRED, NO_JOINTS, OUT_OF_ORDER, UNSURE)
SOUND = REASONS.index(PAIRED)


@dataclass(frozen=True)
class HandGuidedSettings:
    """How poses are taken of a hand-guided arm.

    A pose is taken whenever the joints have gone `spacing` (rad, of all together) since the last
    one, but none within `seated` (s) of where a contact begins or ends. `max_gap` (s) is the
    longest gap between joint states that is interpolated across. Messages that come up to
    `lateness` (s) late are put in their place.
    """

    spacing: float = 0.1
    seated: float = 0.05
    max_gap: float = 0.02
    lateness: float = 0.0


class PairedReading(NamedTuple):
    """A reading with the joints (n,) at its stamp (ns); `reason` says why there are none."""

    stamp: int
    joints: Array | None
    displacement: Array
    reason: str = PAIRED


@dataclass(frozen=True)
class PairedReadings:
    """Many of them: `stamp` (N,), `joints` (N, n), NaN where there are none, `displacement` (N, 3),
    `reason` (N,) as places in `REASONS`, and how wide (ns) the `gap` (N,) was that was interpolated
    across."""

    stamp: Rows
    joints: Array
    displacement: Array
    reason: Rows
    gap: Rows

    @property
    def paired(self) -> NDArray[np.bool_]:
        """Which of them have joints."""
        return self.reason == SOUND

    @staticmethod
    def of(readings: Sequence[PairedReading]) -> PairedReadings:
        """The columns of readings."""
        known = [each.joints for each in readings if each.joints is not None]
        joints = np.full((len(readings), len(known[0]) if known else 0), np.nan)
        joints[[each.joints is not None for each in readings]] = known or joints[:0]
        return PairedReadings(
            np.array([each.stamp for each in readings], dtype=np.int64),
            joints,
            np.array([each.displacement for each in readings]).reshape(-1, 3),
            np.array([REASONS.index(each.reason) for each in readings], dtype=np.int64),
            np.zeros(len(readings), dtype=np.int64),
        )

    def part(self, rows: slice) -> PairedReadings:
        """Some of them."""
        return PairedReadings(
            self.stamp[rows],
            self.joints[rows],
            self.displacement[rows],
            self.reason[rows],
            self.gap[rows],
        )


def pair_readings(streams: RawStreams, max_gap: float, shift: int = 0) -> PairedReadings:
    """Every reading of streams in order with the joints at its stamp, `shift` (ns) later.

    `max_gap` (s) is the longest gap between joint states that is interpolated across.
    """
    reason = objections(streams.status, streams.displacement)
    stamp, states = streams.reading_stamp, streams.joints
    good = np.flatnonzero(reason == SOUND)
    there = interpolated(streams.joint_stamp, states, stamp[good] + shift, max_gap)
    reason[good[~there.known]] = REASONS.index(NO_JOINTS)
    joints = np.full((len(stamp), states.shape[1]), np.nan)
    gap = np.zeros(len(stamp), dtype=np.int64)
    joints[good], gap[good] = there.joints, there.gap
    return PairedReadings(stamp, joints, streams.displacement, reason, gap)


def paired_parts(streams: RawStreams, max_gap: float, shift: int = 0) -> Iterator[PairedReadings]:
    """The same, so many readings at a time: with joints each takes several times as much memory as
    it does in the streams."""
    stamp, states = streams.reading_stamp, streams.joint_stamp
    for begin in range(0, len(stamp), PART):
        some = slice(begin, begin + PART)
        first, last = stamp[some][[0, -1]] + shift
        around = states_around(states, first, last)
        part = RawStreams(
            states[around],
            streams.joints[around],
            stamp[some],
            streams.displacement[some],
            streams.status[some],
        )
        yield pair_readings(part, max_gap, shift)


class Gaps:
    """Counts the gaps between joint states that readings were interpolated across."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()

    def see(self, gap: Rows) -> None:
        """Take in gaps (N,), ns; 0 is none."""
        steps, counts = np.unique(np.rint(gap[gap > 0] / STEP), return_counts=True)
        for step, count in zip(steps.tolist(), counts.tolist(), strict=True):
            self._counts[int(step)] += count

    @property
    def bridged(self) -> int:
        """How many readings were paired across joint states that are missing: what the arm did
        there is less well known."""
        gaps = sorted(self._counts)
        reached = accumulate(self._counts[gap] for gap in gaps)
        half = self._counts.total() / 2
        usual = next((gap for gap, so_far in zip(gaps, reached, strict=True) if so_far > half), 0)
        return sum(self._counts[gap] for gap in gaps if gap > WIDE * usual)
