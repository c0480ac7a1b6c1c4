# SPDX-License-Identifier: Apache-2.0
"""Joint states that repeat an old position: a driver that asks its controller more seldom than it
publishes, or one that hung for a while."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, largest_steps
from calib_model.stamps import SECOND

LONG = 0.05  # s for which a driver repeats before it is said to hang
JUMP = 3.0  # times the fastest that the arm is seen to go: what was missed in between
FASTEST = 0.995  # of the steps
UNEVEN = 1.5  # periods that one may last
SELDOM = 0.25  # s: positions that are new less often are those of an arm that stands in between
GOES_ON = 0.2  # correlation of steps one after the other
FEWEST = 3  # new positions of which a rate can be told


@dataclass(frozen=True)
class Freshness:
    """How often joint positions are new, `every` s, and `sent`, s, both as the median; 0 where
    nothing moves. `sound` (M,) says which joint states are not an old position sent again, and
    `hung` when (row) and for how long (s) a driver did nothing but repeat."""

    every: float
    sent: float
    sound: NDArray[np.bool_]
    hung: tuple[tuple[int, float], ...] = ()

    @property
    def repeats(self) -> bool:
        """Whether most of what is sent is no new position."""
        return self.every > 2 * self.sent > 0

    def rate(self) -> str:
        """How often, in words."""
        sent = f' ({1 / self.sent:.0f} are sent, most of them repeat)' if self.repeats else ''
        return f'joint positions are new {1 / self.every:.1f} times a second{sent}'


def freshness(stamp: NDArray[np.int64], joints: Array) -> Freshness:
    """What of joint states (M, n), rad, at stamps (M,), ns, in order, is new.

    An arm that stands gives the same position again and again, and rightly so. Old is what comes in
    the last period before a new position, where most positions are sent several times while the arm
    moves, which is seen by its going on from one to the next as it came; and all repeats before a
    jump that the arm cannot have made in one step.
    """
    sound = np.ones(len(stamp), dtype=np.bool_)
    if len(stamp) < 2:
        return Freshness(0.0, 0.0, sound)
    gap, step = np.diff(stamp), largest_steps(joints)
    new = np.flatnonzero(step > 0) + 1
    sent = float(np.median(gap)) / SECOND
    if len(new) < FEWEST:
        return Freshness(0.0, sent, sound)
    every = float(np.median(np.diff(stamp[new]))) / SECOND
    first = np.concatenate([[0], new])  # of each run of one position
    length = np.diff(np.append(first, len(stamp)))
    if every > 2 * sent:
        if every > SELDOM or _goes_on(joints[first]) < GOES_ON:
            return Freshness(every, sent, sound)
        until = np.append(stamp[new], stamp[-1]) - round(UNEVEN * every * SECOND)
        old = stamp > np.repeat(until, length)
        old[first] = False
        return Freshness(every, sent, ~old)
    speed = step[new - 1] * SECOND / gap[new - 1]
    most = JUMP * float(np.quantile(speed, FASTEST))
    lasted = (stamp[new - 1] - stamp[first[:-1]]) / SECOND
    hangs = np.flatnonzero((lasted > LONG) & (speed > most))
    for run in hangs:
        sound[first[run] + 1 : new[run]] = False
    return Freshness(every, sent, sound, tuple((int(first[r]), float(lasted[r])) for r in hangs))


def _goes_on(joints: Array) -> float:
    """How far steps between joints (K, n) go on as the one before, from -1 to 1."""
    step = np.diff(joints, axis=0)
    if len(step) < 2:
        return 0.0
    size = np.linalg.norm(step[1:], axis=1) * np.linalg.norm(step[:-1], axis=1)
    return float(np.median((step[1:] * step[:-1]).sum(axis=1) / size))
