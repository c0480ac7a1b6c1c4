# SPDX-License-Identifier: Apache-2.0
"""Pairing on the move: every probe reading gets the joints at its stamp, or a reason why not.

Only stamps decide, never the time of arrival of one stream against the other, so the same streams
give the same poses live and from a bag.
"""

from __future__ import annotations

from bisect import insort
from collections import Counter, deque
from dataclasses import dataclass
from itertools import accumulate
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from calib_model.arrays import Array
from calib_model.pairing.from_streams import SEATED, SPACING
from calib_model.pairing.stop_and_go import (
    STEP_BACK,
    JointSample,
    Reading,
    Reason,
    joints_at,
    objection,
)
from calib_model.stamps import SECOND

LONGEST_WAIT = 60 * SECOND  # ns that one stream waits for the other
STEP = SECOND // 10_000  # ns to which gaps between joint states are counted
WIDE = 1.5  # of the usual gap: a joint state is missing there
BRIDGED = '{} readings paired across missing joint states'
NO_JOINTS = Reason.JOINTS_MISSING.value
OUT_OF_ORDER = 'out of order'
UNSURE = 'publisher started anew'
NO_SPHERE = 'no sphere known there'
NO_TOUCH = 'no sphere of that diameter touches the tips'


@dataclass(frozen=True)
class HandGuidedSettings:
    """How poses are taken of a hand-guided arm.

    A pose is taken whenever the joints have gone `spacing` (rad, of all together) since the last
    one, but none within `seated` (s) of where a contact begins or ends. `max_gap` (s) is the
    longest gap between joint states that is interpolated across: a moving arm is nowhere near a
    straight line for long. Messages that come up to `lateness` (s) late are put in their place.
    """

    spacing: float = SPACING
    seated: float = SEATED
    max_gap: float = 0.02
    lateness: float = 0.0


class PairedReading(NamedTuple):
    """A reading with the joints (n,) at its stamp (ns); `reason` says why there are none."""

    stamp: int
    joints: Array | None
    displacement: Array
    reason: str = ''


Stamped = TypeVar('Stamped', JointSample, Reading)


class _InOrder(Generic[Stamped]):
    """Lets the messages of one stream through in the order of their stamps, each stamp once."""

    def __init__(self, lateness: int) -> None:
        self._lateness = lateness
        self._early: list[Stamped] = []
        self.newest = -1
        self._passed = -1

    def add(self, message: Stamped) -> tuple[list[Stamped], list[Stamped]]:
        """The messages whose turn it is, and those whose place has been passed."""
        insort(self._early, message, key=_stamp)
        self.newest = max(self.newest, message.stamp)
        return self._through(self.newest - self._lateness)

    def rest(self) -> tuple[list[Stamped], list[Stamped]]:
        """All that is left."""
        return self._through(self.newest)

    def _through(self, until: int) -> tuple[list[Stamped], list[Stamped]]:
        ready: list[Stamped] = []
        late: list[Stamped] = []
        while self._early and self._early[0].stamp <= until:
            message = self._early.pop(0)
            (ready if message.stamp > self._passed else late).append(message)
            self._passed = max(self._passed, message.stamp)
        return ready, late


class HandGuidedPairing:
    """Takes both streams message by message and accounts for every reading, once.

    `shift` (ns) is added to the readings' stamps to have them in the joints' clock.
    """

    def __init__(self, settings: HandGuidedSettings, shift: int = 0) -> None:
        self.late_joints = 0  # joint states whose place had been passed
        self.steps_back = 0  # how often the joints' stamps began anew
        self._gaps: Counter[int] = Counter()  # between joint states that were used
        self._settings = settings
        self._shift = shift
        self._newest_joints = -1
        self._begin()

    def _begin(self) -> None:
        lateness = round(self._settings.lateness * SECOND)
        self._of_arm: _InOrder[JointSample] = _InOrder(lateness)
        self._of_probe: _InOrder[Reading] = _InOrder(lateness)
        self._joints: deque[JointSample] = deque()
        self._waiting: deque[Reading] = deque()

    def add_joints(self, sample: JointSample) -> list[PairedReading]:
        """Take one joint state; returns the readings that it settles."""
        left = self._fallen_back(self._of_arm.newest, sample.stamp)
        self.steps_back += sample.stamp < self._newest_joints - STEP_BACK
        self._newest_joints = sample.stamp
        ready, late = self._of_arm.add(sample)
        self._joints.extend(ready)
        self.late_joints += len(late)
        return left + self._settled()

    def add_reading(self, reading: Reading) -> list[PairedReading]:
        """Take one probe reading; returns the readings that it settles."""
        shifted = reading._replace(stamp=reading.stamp + self._shift)
        left = self._fallen_back(self._of_probe.newest, shifted.stamp)
        ready, late = self._of_probe.add(shifted)
        self._waiting.extend(ready)
        return left + [self._refused(each, OUT_OF_ORDER) for each in late] + self._settled()

    def start_over(self) -> list[PairedReading]:
        """Refuse all that waits, and forget the joints: they may not belong together."""
        refused = [self._refused(each, UNSURE) for each in self._of_probe.rest()[0]]
        refused += [self._refused(each, UNSURE) for each in self._waiting]
        self._begin()
        return refused

    def finish(self) -> list[PairedReading]:
        """Settle all that is left: no more messages are coming."""
        samples, late = self._of_arm.rest()
        self._joints.extend(samples)
        self.late_joints += len(late)
        ready, passed = self._of_probe.rest()
        self._waiting.extend(ready)
        settled = [self._refused(each, OUT_OF_ORDER) for each in passed] + self._settled()
        settled += [self._refused(each, NO_JOINTS) for each in self._waiting]
        self._waiting.clear()
        return settled

    @property
    def bridged(self) -> int:
        """How many readings were paired across joint states that are missing: a moving arm is a
        little beside the straight line there."""
        gaps = sorted(self._gaps)
        reached = accumulate(self._gaps[gap] for gap in gaps)
        half = self._gaps.total() / 2
        usual = next((gap for gap, so_far in zip(gaps, reached, strict=True) if so_far > half), 0)
        return sum(self._gaps[gap] for gap in gaps if gap > WIDE * usual)

    def _fallen_back(self, newest: int, stamp: int) -> list[PairedReading]:
        if stamp >= newest - STEP_BACK:
            return []
        left = self.finish()
        self._begin()
        return left

    def _settled(self) -> list[PairedReading]:
        settled = []
        while self._waiting:
            reading = self._waiting[0]
            against = objection(reading.status, reading.displacement)
            reason = against.value if against is not None else ''
            if not reason and not (self._joints and self._joints[-1].stamp >= reading.stamp):
                if reading.stamp >= self._of_probe.newest - LONGEST_WAIT:
                    break
                reason = NO_JOINTS
            self._waiting.popleft()
            settled.append(self._refused(reading, reason) if reason else self._paired(reading))
        self._forget()
        return settled

    def _paired(self, reading: Reading) -> PairedReading:
        while len(self._joints) > 1 and self._joints[1].stamp <= reading.stamp:
            self._joints.popleft()
        around = [self._joints[0], self._joints[min(1, len(self._joints) - 1)]]
        joints = joints_at(around, reading.stamp, self._settings.max_gap)
        if joints is None:
            return self._refused(reading, NO_JOINTS)
        if around[1].stamp > around[0].stamp:
            self._gaps[round((around[1].stamp - around[0].stamp) / STEP)] += 1
        return PairedReading(reading.stamp - self._shift, joints, reading.displacement)

    def _refused(self, reading: Reading, reason: str) -> PairedReading:
        return PairedReading(reading.stamp - self._shift, None, reading.displacement, reason)

    def _forget(self) -> None:
        """Drop joint states that readings so far behind will not come for."""
        while len(self._joints) > 1 and self._joints[1].stamp < self._of_arm.newest - LONGEST_WAIT:
            self._joints.popleft()


def _stamp(message: JointSample | Reading) -> int:
    return message.stamp


def travel(first: Array, second: Array) -> float:
    """How far apart two postures (n,) are, rad, of all joints together."""
    return float(np.linalg.norm(second - first))
