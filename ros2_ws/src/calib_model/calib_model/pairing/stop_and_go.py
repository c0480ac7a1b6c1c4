# SPDX-License-Identifier: Apache-2.0
"""Pairing of probe readings with the joints at their stamps, and what makes a pose count.

A pose counts once per stop of the arm: after the joints have been still for `settle`, the
readings of the next `dwell` are averaged, and the joints too. Only stamps decide, never the time of
arrival, so the same streams give the same poses live and from a bag.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.pairing.interpolation import between
from calib_model.pairing.readings import GRAVEST, JointSample, Reading, Reason, objections, usable
from calib_model.pairing.stops import MANY, SURE, Line, Stillness, Stop, StopFinder, UsualNoise
from calib_model.pairing.streams import STEP_BACK
from calib_model.stamps import SECOND

WHITE = 1.5  # of their noise from one to the next: more is a swing
NOISIEST = 5.0  # times the spread that is asked for
FEW_DRIFT = 0.2  # of the spread: what few readings may drift, whatever their noise
DRIFT = 1e-4  # rad over the dwell: an arm that moves so much is not averaged


@dataclass(frozen=True)
class SteadySettings:
    """When a stop counts: times in s, `max_speed` in rad/s, `max_spread` in m (peak to peak;
    where many readings scatter like noise, of what they drift).

    `max_gap` is the longest gap between joint states that is interpolated across. Messages of one
    stream that come up to `lateness` late are put in their place.
    """

    settle: float = 0.01
    dwell: float = 0.03
    max_speed: float = 1e-3
    max_spread: float = 2e-5
    max_gap: float = 0.1
    min_readings: int = 2
    lateness: float = 0.0


@dataclass(frozen=True)
class SteadyPose:
    """Averaged readings: `displacement` (3,) in m, `joints` (n,) in rad at `stamp` in ns."""

    stamp: int
    joints: Array
    displacement: Array
    readings: int


@dataclass(frozen=True)
class Refusal:
    """A stop at `joints` (n,), from `stamp` (ns) on, that gave no pose."""

    stamp: int
    joints: Array
    reason: Reason


Outcome = SteadyPose | Refusal


def still_as(settings: SteadySettings) -> Stillness:
    """What counts as still by these settings."""
    settle, dwell, gap = (
        round(each * SECOND) for each in (settings.settle, settings.dwell, settings.max_gap)
    )
    return Stillness(settle, dwell, gap, settings.max_speed)


def _stamp(sample: JointSample | Reading) -> int:
    return sample.stamp


class Pairing:
    """Takes both streams message by message and gives an outcome for every stop of the arm.

    `usual` is what earlier stops of the same streams told of the readings' noise.
    """

    def __init__(self, settings: SteadySettings, usual: UsualNoise | None = None) -> None:
        self.settings = settings
        self._usual = UsualNoise() if usual is None else usual
        self.too_late = 0  # messages that came after their place had been passed
        self.steps_back = 0  # how often the joints' stamps began anew
        self._settle = round(settings.settle * SECOND)
        self._window = round((settings.settle + settings.dwell) * SECOND)
        self._lateness = round(settings.lateness * SECOND)
        self._step_back = max(STEP_BACK, self._lateness)
        self._begin()

    def _begin(self) -> None:
        self._early_joints: list[JointSample] = []
        self._stops = StopFinder(still_as(self.settings))
        self._waiting: deque[Stop] = deque()
        self._newest_joints = -1
        self._begin_readings()

    def _begin_readings(self) -> None:
        self._early_readings: list[Reading] = []
        self._readings: deque[Reading] = deque()
        self._last_reading = self._newest_reading = -1

    def start_over(self) -> None:
        """Forget the arm's last stop and all readings: they may not belong together."""
        self._begin()

    def add_joints(self, sample: JointSample) -> list[Outcome]:
        """Take one joint state; returns what it settled.

        Stamps that fall begin anew: what had come of the time before is settled as it is.
        """
        before: list[Outcome] = []
        if sample.stamp < self._newest_joints - self._step_back:
            self.steps_back += 1
            before = self.finish()
            self._begin()
        insort(self._early_joints, sample, key=_stamp)
        newest = self._newest_joints = max(self._newest_joints, sample.stamp)
        while self._early_joints and self._early_joints[0].stamp <= newest - self._lateness:
            self._take_joints(self._early_joints.pop(0))
        return before + self._settled()

    def add_reading(self, reading: Reading) -> list[Outcome]:
        """Take one probe reading; returns what it settled."""
        if reading.stamp < self._newest_reading - self._step_back:
            self._begin_readings()
        self._newest_reading = max(self._newest_reading, reading.stamp)
        insort(self._early_readings, reading, key=_stamp)
        newest = self._early_readings[-1].stamp
        while self._early_readings and self._early_readings[0].stamp <= newest - self._lateness:
            self._take_reading(self._early_readings.pop(0))
        return self._settled()

    def finish(self) -> list[Outcome]:
        """Settle with what is there: no more messages are coming for the stops so far."""
        for sample in self._early_joints:
            self._take_joints(sample)
        for reading in self._early_readings:
            self._take_reading(reading)
        self._early_joints, self._early_readings = [], []
        outcomes = [self._outcome(stop) for stop in self._waiting]
        self._waiting.clear()
        return outcomes

    def _take_joints(self, sample: JointSample) -> None:
        now = self._stops.stop
        before = sample if now is None else now.samples[-1]
        if now is not None and sample.stamp <= before.stamp:
            self.too_late += 1
            return
        self._waiting.extend(self._stops.take(sample))
        after = self._stops.stop
        if after is not now or (after is not None and after.answered and len(after.samples) == 2):
            self._forget(before.stamp)

    def _forget(self, stamp: int) -> None:
        """Drop readings from before a stamp (ns) that no stop is waiting for."""
        while not self._waiting and self._readings and self._readings[0].stamp < stamp:
            self._readings.popleft()

    def _take_reading(self, reading: Reading) -> None:
        if reading.stamp <= self._last_reading:
            self.too_late += 1
            return
        self._last_reading = reading.stamp
        self._readings.append(reading)

    def _settled(self) -> list[Outcome]:
        """Outcomes of the stops whose readings are all in: one from after the window has come."""
        outcomes: list[Outcome] = []
        while self._waiting:
            stop = self._waiting[0]
            if stop.answered and self._last_reading < stop.samples[0].stamp + self._window:
                break
            outcomes.append(self._outcome(self._waiting.popleft()))
        return outcomes

    def _outcome(self, stop: Stop) -> Outcome:
        start = stop.samples[0].stamp
        if not stop.answered:
            return Refusal(start, stop.samples[0].joints, Reason.ARM_UNSTEADY)
        while self._readings and self._readings[0].stamp < start + self._settle:
            self._readings.popleft()
        count = sum(reading.stamp <= start + self._window for reading in self._readings)
        if count < self.settings.min_readings:
            return Refusal(start, self._stands(stop), Reason.NO_READINGS)
        readings = list(islice(self._readings, count))
        displacement = np.array([reading.displacement for reading in readings])
        reason = self._objection(readings, displacement)
        if reason is not None:
            return Refusal(start, self._stands(stop), reason)
        stamp = start + sum(reading.stamp - start for reading in readings) // count
        joints = self._joints_at(stamp, stop.samples)
        return SteadyPose(stamp, joints, frozen(displacement.mean(axis=0)), count)

    def _stands(self, stop: Stop) -> Array:
        """Where the arm stands in the window (n,): at its beginning it may still come to rest."""
        first, end = stop.start + self._settle, stop.start + self._window
        there = [each.joints for each in stop.samples if first <= each.stamp <= end]
        return frozen(np.median(there, axis=0)) if there else stop.samples[0].joints

    def _joints_at(self, stamp: int, samples: Sequence[JointSample]) -> Array:
        """The joints (n,) of a stop at a stamp: averaged, where many states show no motion."""
        dwelling = self._stops.still.dwelling(samples)
        if len(dwelling) >= MANY:  # of few the last of the motion would be too large a part
            line = Line.through(dwelling)
            if (np.abs(line.slope) * self.settings.dwell).max() <= DRIFT:
                return line.at(stamp)
        after = max(1, bisect_left(samples, stamp, key=_stamp))
        around = samples[after - 1 : after + 1]
        if len(around) < 2:
            return frozen(np.where(around[0].stamp == stamp, around[0].joints, np.nan))
        (first, before), (last, behind) = around
        return frozen(between(first, before, last, behind, stamp, self.settings.max_gap))

    def _objection(self, readings: list[Reading], displacement: Array) -> Reason | None:
        """What speaks against a window's readings, the gravest first; `displacement` (K, 3) is
        theirs."""
        if any(any(reading.status) for reading in readings) or not usable(displacement):
            status = np.array([reading.status for reading in readings])
            return GRAVEST[int(objections(status, displacement).min())]
        stamps = np.array([reading.stamp for reading in readings])
        rest = self._rest(stamps, displacement)
        self._usual.see(displacement)
        return None if rest else Reason.STYLI_UNSTEADY

    def _rest(self, stamps: NDArray[np.int64], displacement: Array) -> bool:
        """Whether the styli rest: their readings (K, 3) are not farther apart than `max_spread`,
        or scatter more, but from reading to reading and not about a mean that moves. The few of a
        stop drift no more than is usual, either: the mean of three is off by a third of what the
        first is."""
        most = self.settings.max_spread
        line = Line(stamps, displacement)
        seconds = float(stamps[-1] - stamps[0]) / SECOND
        spread = (displacement.max(axis=0) - displacement.min(axis=0)).max()
        if len(stamps) < MANY:
            usual = max(FEW_DRIFT * most, SURE * np.sqrt(2) * self._usual.known)
            return bool(spread <= most and np.abs(line.slope).max() * seconds <= usual)
        if spread <= most:
            return True
        drift = (np.abs(line.slope) - SURE * line.slope_deviation) * seconds
        noisy = line.scatter <= np.minimum(WHITE * line.noise, NOISIEST * most)
        return bool((drift <= most).all() and (noisy | (line.scatter <= most / SURE)).all())
