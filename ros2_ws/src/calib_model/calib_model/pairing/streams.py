# SPDX-License-Identifier: Apache-2.0
"""The two raw streams, joint states and probe readings, as arrays: as received, and in order.

What live pairing decides message by message, which of them come too late for their place and where
a stream begins anew, is decided here for all messages at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.stamps import SECOND

STEP_BACK = SECOND  # ns by which stamps fall when a clock was set back or a driver started anew
BEFORE_ALL = np.iinfo(np.int64).min
WINDOW = 256  # messages that are looked at first for a fall
Rows = NDArray[np.int64]


@dataclass(frozen=True)
class RawStreams:
    """Joints (M, n) in rad at `joint_stamp` (M,), ns, displacements (N, 3) in m and the styli's
    `status` (N, 3) at `reading_stamp` (N,), NaN where one is no number; both in the
    stamps' order, no stamp twice.

    `late_joints` and `late_readings` count what came too late for its place or had the stamp of
    another.
    """

    joint_stamp: Rows
    joints: Array
    reading_stamp: Rows
    displacement: Array
    status: NDArray[np.uint8]
    late_joints: int = 0
    late_readings: int = 0

    @property
    def late(self) -> int:
        """Messages of both streams that were left out for their place."""
        return self.late_joints + self.late_readings

    @property
    def seconds(self) -> float:
        """From the first joint state to the last."""
        return float(self.joint_stamp[-1] - self.joint_stamp[0]) / SECOND


def _uncopied(rows: Rows, of: Rows) -> Rows | slice:
    """The rows; all of them in their order as a slice, which copies nothing."""
    whole = len(rows) == len(of) and bool((rows[1:] > rows[:-1]).all())
    return slice(None) if whole else rows


@dataclass(frozen=True)
class RecordedStreams:
    """Both streams as they were received: `joint_number` (M,) and `reading_number` (N,) say which
    message of both each was. The rest is as in `RawStreams`, but for the order."""

    joint_number: Rows
    joint_stamp: Rows
    joints: Array
    reading_number: Rows
    reading_stamp: Rows
    displacement: Array
    status: NDArray[np.uint8]

    @property
    def end(self) -> int:
        """A number beyond all messages."""
        last = np.concatenate([[-1], self.joint_number[-1:], self.reading_number[-1:]])
        return int(last.max()) + 1

    def ordered(self, lateness: float, broken_off: bool = False) -> RawStreams:
        """Both streams as live pairing puts them in order; nothing falls back in them.

        Where readings are `broken_off`, those that still waited for late ones are lost.
        """
        states = in_order(self.joint_stamp, lateness)
        readings = in_order(self.reading_stamp, lateness)
        count = len(self.reading_stamp)
        if broken_off and count:
            last = self.reading_stamp.max() - round(lateness * SECOND)
            readings = readings[self.reading_stamp[readings] <= last]
            count = int((self.reading_stamp <= last).sum())
        late = len(self.joint_stamp) - len(states), count - len(readings)
        arm, probe = _uncopied(states, self.joint_stamp), _uncopied(readings, self.reading_stamp)
        return RawStreams(
            self.joint_stamp[arm],
            self.joints[arm],
            self.reading_stamp[probe],
            self.displacement[probe],
            self.status[probe],
            *late,
        )

    def stretches(self) -> Iterator[RecordedStreams]:
        """What was received until one of the streams began anew with earlier stamps, and so on."""
        if not any(_fallen(each).any() for each in (self.joint_stamp, self.reading_stamp)):
            yield self
            return
        number = np.concatenate([self.joint_number, self.reading_number])
        order = np.argsort(number, kind='stable')
        stamp = np.concatenate([self.joint_stamp, self.reading_stamp])[order]
        stream = (order >= len(self.joint_number)).astype(np.int64)
        for stretch in unbroken(stamp, stream):
            first, last = number[order[stretch.start]], number[order[stretch.stop - 1]]
            yield self.received(int(first), int(last) + 1)

    def by_readings(self, step_back: int) -> Iterator[RecordedStreams]:
        """The same with those readings alone that came until they began anew, and so on."""
        probe = np.zeros(len(self.reading_stamp), dtype=np.int64)
        stretches = list(unbroken(self.reading_stamp, probe, step_back)) or [slice(0, 0)]
        for readings in stretches:
            yield replace(
                self,
                reading_number=self.reading_number[readings],
                reading_stamp=self.reading_stamp[readings],
                displacement=self.displacement[readings],
                status=self.status[readings],
            )

    def received(self, begin: int, end: int) -> RecordedStreams:
        """The messages with numbers from `begin` up to `end`, the latter left out."""
        states = slice(*np.searchsorted(self.joint_number, [begin, end]))
        readings = slice(*np.searchsorted(self.reading_number, [begin, end]))
        return RecordedStreams(
            self.joint_number[states],
            self.joint_stamp[states],
            self.joints[states],
            self.reading_number[readings],
            self.reading_stamp[readings],
            self.displacement[readings],
            self.status[readings],
        )


def _fallen(stamp: Rows, step_back: int = STEP_BACK) -> NDArray[np.bool_]:
    """Which of the stamps (N,), as received, are more than `step_back` behind the newest."""
    newest: Rows = np.maximum.accumulate(stamp)
    return newest - stamp > step_back


def in_order(stamp: Rows, lateness: float) -> Rows:
    """The rows of stamps (N,), ns, as received, in the order of the stamps, each stamp once.

    A message that comes up to `lateness` (s) late is put in its place; one that comes later, or
    has the stamp of an earlier one, is left out.
    """
    if not len(stamp):
        return np.zeros(0, dtype=np.int64)
    if (stamp[1:] > stamp[:-1]).all():
        return np.arange(len(stamp))
    newest = np.maximum.accumulate(stamp)
    # the message that lets each one pass, itself or a newer one; for the last there is none
    leaves = np.searchsorted(newest, stamp + round(lateness * SECOND))
    leaves = np.maximum(leaves, np.arange(len(stamp)))
    passed: Rows = np.full(len(stamp) + 1, BEFORE_ALL)
    np.maximum.at(passed, leaves, stamp)
    passed = np.maximum.accumulate(passed)
    in_time = np.flatnonzero(np.append(True, stamp[1:] > passed[: len(stamp) - 1]))
    return in_time[np.unique(stamp[in_time], return_index=True)[1]]


def unbroken(stamp: Rows, stream: Rows, step_back: int = STEP_BACK) -> Iterator[slice]:
    """The stretches of messages with stamps (N,), ns, of one or several streams (N,), as received,
    within which no stream falls back by more than `step_back` (ns) behind its newest."""
    begin, window = 0, WINDOW
    while begin < len(stamp):
        part = slice(begin, begin + window)
        fall = _first_fall(stamp[part], stream[part], step_back)
        if fall is None and part.stop < len(stamp):
            window *= 4
            continue
        end = part.stop if fall is None else begin + fall
        yield slice(begin, min(end, len(stamp)))
        begin, window = end, WINDOW


def _first_fall(stamp: Rows, stream: Rows, step_back: int) -> int | None:
    falls = np.zeros(len(stamp), dtype=np.bool_)
    for number in np.unique(stream):
        mine = np.flatnonzero(stream == number)
        falls[mine] = _fallen(stamp[mine], step_back)
    return int(falls.argmax()) if falls.any() else None
