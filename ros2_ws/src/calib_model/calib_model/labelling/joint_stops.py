# SPDX-License-Identifier: Apache-2.0
"""Postures of an arm from its joint states alone: where it stopped, or where its tip stayed.

Of a ball in a socket every joint state is a pose, also while the arm turns about the ball: no
reading has to be paired with it. What counts is that the ball sits, and that no posture is counted
twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.pairing import Rows
from calib_model.stamps import SECOND

SAME = 2e-3  # rad from the median of a stop up to which its states are averaged, and
WIDE = 4.0  # times their median distance from it
EXACT = 1e-9  # rad: equal, but for rounding
AGAIN = 0.02  # rad between two stops that are one posture
LONGEST_GAP = 2.0  # s between the states of one stop
SPARSE = 0.1  # rad from state to state, as a rule: such states are postures by themselves
BEAT = 0.02  # s between states that are looked at where a tip stays
SEAT = 0.3  # s that it stays at least


@dataclass(frozen=True)
class Postures:
    """Joints (N, n), rad, at `stamp` (N,), ns, each the mean of `states` (N,) joint states."""

    stamp: Rows
    joints: Array
    states: Rows

    @staticmethod
    def of_rows(stamp: Rows, joints: Array, rows: Rows) -> Postures:
        """Some of the states (M,), by themselves."""
        return Postures(stamp[rows], joints[rows], np.ones(len(rows), dtype=np.int64))


def stops(stamp: Rows, joints: Array, dwell: float, max_speed: float) -> Postures:
    """The postures in which the arm of the states (M, n) stood: `dwell` (s) and longer, at no more
    than `max_speed` (rad/s).

    A stop is the mean of its states near their median: the arm still comes to rest in the first,
    and a hand may drift. Stops one after the other in one posture are one, the longest, where the
    arm did not leave it between them.
    """
    found: list[tuple[int, Rows]] = []
    for first, last in _standing(stamp, joints, dwell, max_speed):
        near = _core(joints, np.arange(first, last + 1))
        if found and _one_posture(joints, found[-1][1], near):
            if stamp[last] - stamp[first] <= found[-1][0]:
                continue
            found.pop()
        found.append((int(stamp[last] - stamp[first]), near))
    n = joints.shape[1]
    return Postures(
        np.array([_mean_stamp(stamp[rows]) for _, rows in found], dtype=np.int64),
        np.array([_mean(joints[rows]) for _, rows in found]).reshape(-1, n),
        np.array([len(rows) for _, rows in found], dtype=np.int64),
    )


def held_posture(joints: Array) -> Array:
    """The posture (n,) of states (M, n) of an arm that a hand holds."""
    return _mean(joints[_core(joints, np.arange(len(joints)))])


def single_states(stamp: Rows, joints: Array) -> Postures | None:
    """Every state, once where it is repeated, as a posture of its own where somebody recorded
    postures, not a motion; None where states are too close to one another for that."""
    steps = travel_steps(joints)
    moves = steps[steps > SAME]
    if not len(moves) or np.median(moves) < SPARSE:
        return None
    new = np.concatenate([[True], steps > AGAIN])
    return Postures.of_rows(stamp, joints, np.flatnonzero(new))


def way(stamp: Rows, joints: Array) -> float:
    """How far the arm has gone, rad of all joints together; noise of encoders is no way."""
    rows = beats(stamp, 0.2)
    steps = travel_steps(joints[rows])
    return float(steps[steps > SAME].sum())


def beats(stamp: Rows, every: float = BEAT) -> Rows:
    """The first state of each beat (s)."""
    slot = (stamp - stamp[0]) // round(every * SECOND)
    rows: Rows = np.unique(slot, return_index=True)[1]
    return rows


def spaced(joints: Array, spacing: float) -> Rows:
    """Rows of postures (N, n), the first and then each that is `spacing` (rad, of all joints
    together) from the one before."""
    rows: list[int] = []
    for row, posture in enumerate(joints):
        if not rows or np.linalg.norm(posture - joints[rows[-1]]) >= spacing:
            rows.append(row)
    return np.array(rows, dtype=np.int64)


def travel_steps(joints: Array) -> Array:
    """How far each posture (N, n) is from the one before it (N - 1,), rad."""
    steps: Array = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    return steps


def _standing(stamp: Rows, joints: Array, dwell: float, max_speed: float) -> list[tuple[int, int]]:
    """First and last state of each stretch in which the arm stands."""
    window = round(dwell * SECOND)
    count = len(stamp)
    ends = np.searchsorted(stamp, stamp + window)
    begins = np.flatnonzero(ends < count)
    if not len(begins):
        return []
    ends = ends[begins]
    lasted = stamp[ends] - stamp[begins]
    still: NDArray[np.bool_] = lasted <= window + round(LONGEST_GAP * SECOND)
    for other in ((begins + ends) // 2, ends):
        turned = np.abs(joints[other] - joints[begins]).max(axis=1)
        still &= turned <= max_speed * lasted / SECOND
    edges = np.diff(np.concatenate([[False], still, [False]]).astype(np.int8))
    firsts, lasts = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return [
        (int(begins[i]), int(ends[j])) for i, j in zip(firsts.tolist(), lasts.tolist(), strict=True)
    ]


def _core(joints: Array, rows: Rows) -> Rows:
    """The states of a stop that are no farther from their median than their scatter is wide."""
    off = np.abs(joints[rows] - np.median(joints[rows], axis=0)).max(axis=1)
    core: Rows = rows[off <= min(WIDE * float(np.median(off)), SAME) + EXACT]
    return core if len(core) else rows[off.argmin() :][:1]


def _one_posture(joints: Array, before: Rows, after: Rows) -> bool:
    there = joints[before].mean(axis=0)
    between = joints[before[-1] : after[0] + 1]
    here = np.abs(joints[after].mean(axis=0) - there).max()
    left = np.abs(between - there).max(initial=0.0)
    return bool(here <= AGAIN and left <= 2 * AGAIN)


def _mean(joints: Array) -> Array:
    """Of equal states exactly that state."""
    mean: Array = joints[0] + (joints - joints[0]).mean(axis=0)
    return mean


def _mean_stamp(stamp: Rows) -> int:
    return int(stamp[0] + np.mean(stamp - stamp[0]))
