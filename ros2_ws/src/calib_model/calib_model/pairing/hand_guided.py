# SPDX-License-Identifier: Apache-2.0
"""Pairing on the move: every probe reading gets the joints at its stamp, or a reason why not.

Only stamps decide, never the time of arrival of one stream against the other, so the same streams
give the same poses live and from a bag.
"""

from __future__ import annotations

from bisect import insort
from collections import deque
from typing import Generic, TypeVar

import numpy as np

from calib_model.pairing.paired_readings import (
    OUT_OF_ORDER,
    REASONS,
    SOUND,
    UNSURE,
    Gaps,
    HandGuidedSettings,
    PairedReading,
    pair_readings,
)
from calib_model.pairing.readings import JointSample, Reading
from calib_model.pairing.streams import STEP_BACK, RawStreams
from calib_model.stamps import SECOND

TOGETHER = SECOND // 30  # ns of readings settled together: one by one takes ten times as long
LONGEST_WAIT = 60 * SECOND  # ns that one stream waits for the other: memory is not for ever

Stamped = TypeVar('Stamped', JointSample, Reading)


class _InOrder(Generic[Stamped]):
    """Lets the messages of one stream through in the order of their stamps, each stamp once:
    message by message what `in_order` does of a recording."""

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

    A reading is due with the second joint state after it: the interpolation looks that far. One
    stream waits for the other for a minute of stamps. `shift` (ns) is added to the readings'
    stamps to have them in the joints' clock.
    """

    def __init__(self, settings: HandGuidedSettings, shift: int = 0) -> None:
        self.late_joints = 0  # joint states whose place had been passed
        self.steps_back = 0  # how often the joints' stamps began anew
        self._gaps = Gaps()  # between joint states that were used
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
        settled = self._settle()
        settled += [self._refused(each, UNSURE) for each in self._of_probe.rest()[0]]
        settled += [self._refused(each, UNSURE) for each in self._waiting]
        self._begin()
        return settled

    def finish(self) -> list[PairedReading]:
        """Settle all that is left: no more messages are coming."""
        samples, late = self._of_arm.rest()
        self._joints.extend(samples)
        self.late_joints += len(late)
        ready, passed = self._of_probe.rest()
        self._waiting.extend(ready)
        waiting = list(self._waiting)
        self._waiting.clear()
        return [self._refused(each, OUT_OF_ORDER) for each in passed] + self._paired(waiting)

    @property
    def bridged(self) -> int:
        """How many readings were paired across joint states that are missing."""
        return self._gaps.bridged

    def _fallen_back(self, newest: int, stamp: int) -> list[PairedReading]:
        if stamp >= newest - STEP_BACK:
            return []
        left = self.finish()
        self._begin()
        return left

    def _settled(self) -> list[PairedReading]:
        """What has become due, once that is worth a call."""
        if not self._waiting:
            return []
        first = self._waiting[0]
        both = min(self._of_arm.newest, self._of_probe.newest)
        worth = both - first.stamp >= TOGETHER and self._reached(first.stamp)
        return self._settle() if worth or self._waited_out(first) else []

    def _settle(self) -> list[PairedReading]:
        due: list[Reading] = []
        while self._waiting and (
            self._reached(self._waiting[0].stamp) or self._waited_out(self._waiting[0])
        ):
            due.append(self._waiting.popleft())
        settled = self._paired(due)
        self._forget()
        return settled

    def _waited_out(self, reading: Reading) -> bool:
        return reading.stamp < self._of_probe.newest - LONGEST_WAIT

    def _reached(self, stamp: int) -> bool:
        """Whether all joint states are there that say where the arm was at a stamp (ns)."""
        last = [self._joints[i].stamp for i in range(-min(2, len(self._joints)), 0)]
        return stamp in last or (len(last) == 2 and last[0] > stamp)

    def _paired(self, readings: list[Reading]) -> list[PairedReading]:
        if not readings:
            return []
        around = self._around(readings[0].stamp, readings[-1].stamp)
        streams = RawStreams(
            np.array([each.stamp for each in around], dtype=np.int64),
            np.array([each.joints for each in around]) if around else np.zeros((0, 0)),
            np.array([each.stamp for each in readings], dtype=np.int64),
            np.array([each.displacement for each in readings]),
            np.array([each.status for each in readings]),
        )
        found = pair_readings(streams, self._settings.max_gap)
        self._gaps.see(found.gap)
        return [
            PairedReading(
                reading.stamp - self._shift,
                joints if reason == SOUND else None,
                reading.displacement,
                REASONS[reason],
            )
            for reading, joints, reason in zip(
                readings, found.joints, found.reason.tolist(), strict=True
            )
        ]

    def _around(self, first: int, last: int) -> list[JointSample]:
        """The joint states that decide on readings between two stamps (ns); older ones go."""
        while len(self._joints) > 2 and self._joints[2].stamp <= first:
            self._joints.popleft()
        around, after = [], 0
        for sample in self._joints:
            around.append(sample)
            after += sample.stamp > last
            if after == 2:
                break
        return around

    def _refused(self, reading: Reading, reason: str) -> PairedReading:
        return PairedReading(reading.stamp - self._shift, None, reading.displacement, reason)

    def _forget(self) -> None:
        """Drop joint states that readings so far behind will not come for."""
        while len(self._joints) > 2 and self._joints[2].stamp < self._of_arm.newest - LONGEST_WAIT:
            self._joints.popleft()


def _stamp(message: JointSample | Reading) -> int:
    return message.stamp
