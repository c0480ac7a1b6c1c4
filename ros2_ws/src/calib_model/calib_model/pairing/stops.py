# SPDX-License-Identifier: Apache-2.0
"""When the arm stands: found in its joint states, judged over the dwell, whatever they scatter.

Two successive states tell nothing of an arm's speed where encoders scatter or step. So a stop is a
stretch of states that stay together, and it is steady when a straight line through those of the
dwell rises no faster than `max_speed` beyond what their own scatter leaves open, and when they do
not swing about it more than from state to state.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen, largest_difference
from calib_model.pairing.readings import JointSample
from calib_model.stamps import SECOND

SCATTER = 5e-4  # rad from state to state that may be the encoders'
TOGETHER = 1e-3  # rad from the mean of a stop
SURE = 4.0  # standard deviations
MANY = 10  # states or readings whose noise can be told
FEW = 1e-5  # rad that fewer may drift over the dwell beside their largest speed
KEPT, TELLING = 200, 5  # stops that tell the usual noise of readings: at most, at least
SWING = 5e-5  # rad of scatter that no arm is refused for: steps of coarse encoders


@dataclass(frozen=True)
class Stillness:
    """What counts as still: a stop of `settle` and `dwell` ns, `max_speed` in rad/s, and `gap`, the
    longest between its states, in ns."""

    settle: int
    dwell: int
    gap: int
    max_speed: float

    @property
    def window(self) -> int:
        """Settle and dwell, ns."""
        return self.settle + self.dwell

    @property
    def reach(self) -> float:
        """Rad from the mean of a stop within which its states are."""
        return TOGETHER + self.max_speed * self.window / SECOND

    def together(self, before: JointSample, after: JointSample) -> bool:
        """Whether two successive states may be of one stop."""
        gap = after.stamp - before.stamp
        step = largest_difference(after.joints, before.joints)
        return gap <= self.gap and step <= self.max_speed * gap / SECOND + SCATTER

    def dwelling(self, samples: Sequence[JointSample]) -> Sequence[JointSample]:
        """The states of the dwell; all, where these are fewer than two."""
        begin = samples[0].stamp + self.settle
        first = next((i for i, each in enumerate(samples) if each.stamp >= begin), 0)
        return samples[first:] if len(samples) - first > 1 else samples

    def steady(self, samples: Sequence[JointSample]) -> bool:
        """Whether the arm stands in the dwell of a stop's states, as far as they tell."""
        dwelling = self.dwelling(samples)
        line = Line.through(dwelling)
        if len(dwelling) < MANY:  # how much is noise they cannot tell
            span = max(dwelling[-1].stamp - dwelling[0].stamp, 1) / SECOND
            unsure: Array | float = FEW / span
        else:
            unsure = SURE * line.slope_deviation
        if (np.abs(line.slope) > self.max_speed + unsure).any():
            return False
        return bool((line.scatter <= SURE * line.noise + SWING).all())


class Line:
    """A straight line through values (K, n), rad, at stamps (K,), ns, by least squares: `mean` (n,)
    at the mean `stamp`, `slope` (n,) in rad/s."""

    def __init__(self, stamps: NDArray[np.int64], values: Array) -> None:
        since = stamps - stamps[0]
        middle = float(np.add.reduce(since) / len(stamps))
        self._values = values
        self._t = (since - middle) / SECOND
        self._spread = float(self._t @ self._t)
        self.stamp = float(stamps[0]) + middle
        # equal ones to the last digit
        self.mean: Array = values[0] + np.add.reduce(values - values[0]) / len(stamps)
        self._left = values - self.mean
        self.slope: Array = np.zeros(values.shape[1])
        if self._spread > 0:
            self.slope = self._t @ self._left / self._spread

    @classmethod
    def through(cls, samples: Sequence[JointSample]) -> Line:
        """Joint states."""
        stamps = np.array([each.stamp for each in samples])
        return cls(stamps, np.array([each.joints for each in samples]))

    @cached_property
    def scatter(self) -> Array:
        """About it (n,), rad; of two states the steps that encoders may make."""
        count = len(self._t)
        if count <= 2:
            return np.full(self._values.shape[1], SCATTER / SURE)
        left = self._left - self._t[:, None] * self.slope
        return np.sqrt((left**2).sum(axis=0) / (count - 2))

    @cached_property
    def noise(self) -> Array:
        """What the steps from state to state show of it (n,), rad."""
        if len(self._t) <= 2:
            return self.scatter
        return np.sqrt(np.mean(np.diff(self._values, axis=0) ** 2, axis=0) / 2)

    @property
    def slope_deviation(self) -> Array:
        """The standard deviation (n,) of the slope, rad/s."""
        return self.scatter / np.sqrt(self._spread) if self._spread > 0 else self.scatter

    def at(self, stamp: int) -> Array:
        """The joints (n,) at a stamp, ns."""
        return frozen(self.mean + self.slope * ((stamp - self.stamp) / SECOND))


class UsualNoise:
    """What readings scatter from one to the next (m), told by the stops so far: the few of one stop
    cannot tell their noise from a motion that ends among them."""

    def __init__(self) -> None:
        self._seen: deque[float] = deque(maxlen=KEPT)

    def see(self, values: Array) -> None:
        """The readings (K, 3) of a stop, m."""
        if len(values) > 1:
            steps = values[1:] - values[:-1]
            self._seen.append(math.sqrt(max((steps**2).sum(axis=0)) / len(steps) / 2))

    @property
    def known(self) -> float:
        """The median of the stops'; infinite as long as these are too few."""
        return median(self._seen) if len(self._seen) >= TELLING else math.inf


class Stop:
    """The arm standing still: its states so far, and whether its window is complete."""

    def __init__(self, sample: JointSample) -> None:
        self.samples = [sample]
        self.answered = False
        self.began = sample.stamp
        self._sum = np.array(sample.joints, dtype=np.float64)
        self._count = 1

    @property
    def start(self) -> int:
        """The stamp from which on it counts, ns."""
        return self.samples[0].stamp

    def near(self, sample: JointSample, within: float) -> bool:
        """Whether a state is still where this stop is, `within` so many rad."""
        return largest_difference(sample.joints, self._sum / self._count) <= within

    def add(self, sample: JointSample) -> None:
        """One state more."""
        self.samples.append(sample)
        self._sum += sample.joints
        self._count += 1

    def later(self) -> None:
        """Begin with the next state: in the first the arm still came to rest."""
        self._sum -= self.samples.pop(0).joints
        self._count -= 1


class StopFinder:
    """Takes joint states in the order of their stamps and gives the stops in them: `answered` ones
    when their window is complete, others that were too short when the arm has left."""

    def __init__(self, still: Stillness) -> None:
        self.still = still
        self.stop: Stop | None = None

    def take(self, sample: JointSample) -> list[Stop]:
        """One state later than the one before; at most one stop."""
        stop = self.stop
        if stop is None:
            self.stop = Stop(sample)
            return []
        if not (
            self.still.together(stop.samples[-1], sample) and stop.near(sample, self.still.reach)
        ):
            self.stop = Stop(sample)
            return [stop] if self._too_short(stop) else []
        if stop.answered:
            stop.samples = [stop.samples[0], sample]
            return []
        stop.add(sample)
        while sample.stamp >= stop.start + self.still.window:
            if self.still.steady(stop.samples):
                stop.answered = True
                done = Stop(stop.samples[0])  # a copy: the stop goes on, its window is complete
                done.samples, done.answered = list(stop.samples), True
                return [done]
            stop.later()
        return []

    def _too_short(self, stop: Stop) -> bool:
        """Whether a stop that the arm has left was one."""
        if stop.answered or len(stop.samples) < 2:
            return False
        lasted = stop.samples[-1].stamp - stop.began
        if lasted >= self.still.window:
            return True
        return lasted >= self.still.settle and self.still.steady(stop.samples)
