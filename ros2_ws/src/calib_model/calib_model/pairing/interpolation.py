# SPDX-License-Identifier: Apache-2.0
"""Joints between joint states: the one rule, of all who pair readings with them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.stamps import SECOND

BESIDE = 3  # states on either side of instants, of which the cubic takes two
EVEN = 4.0  # times nearer than the gap is wide: such a neighbour's slope is noise


class JointsAt(NamedTuple):
    """Joints (K, n), rad, at which instants they are `known` (K,), NaN elsewhere, and how wide the
    `gap` (K,) between joint states was there, ns: 0 on a joint state."""

    joints: Array
    known: NDArray[np.bool_]
    gap: NDArray[np.int64]


def interpolated(
    stamp: NDArray[np.int64], joints: Array, at: NDArray[np.int64], max_gap: float
) -> JointsAt:
    """The joints at instants (K,), ns.

    `stamp` (M,), ns, are those of the states `joints` (M, n), in order, none twice. On a joint
    state the joints are that state's. Between two, at most `max_gap` (s) apart, they follow the
    cubic that has at each of the two the slope of the parabola through it and both its neighbours:
    for an arm in motion a straight line is off by a hundredth of a mrad between 250 Hz states. The
    next state on a side does not count where it is more than `max_gap` away, or `EVEN` times as
    near as the two are apart; with only one such neighbour it is a parabola, without any a line.

    So four states decide, whatever comes before and after: live pairing waits for one state more.
    Given two alone, as of an arm at rest, it is the line between them.
    """
    found = np.full((len(at), joints.shape[1]), np.nan)
    known, across = np.zeros(len(at), dtype=np.bool_), np.zeros(len(at), dtype=np.int64)
    if not len(stamp):
        return JointsAt(found, known, across)
    before = np.searchsorted(stamp, at, side='right') - 1
    known = (before >= 0) & (stamp[before] == at)
    found[known] = joints[before[known]]
    gap = np.diff(stamp)
    longest = round(max_gap * SECOND)
    # a gap that overflows comes out negative
    close = np.concatenate([[False], (gap > 0) & (gap <= longest), [False]])
    between = np.flatnonzero(~known & close[before + 1])
    found[between] = _cubic(stamp, joints, gap, close, at[between], before[between])
    known[between], across[between] = True, gap[before[between]]
    return JointsAt(found, known, across)


def states_around(stamp: NDArray[np.int64], first: int, last: int) -> slice:
    """Those of the joint states at `stamp` (M,), ns, in order, that decide on instants from `first`
    to `last`, ns."""
    begin = max(int(np.searchsorted(stamp, first)) - BESIDE, 0)
    return slice(begin, int(np.searchsorted(stamp, last, side='right')) + BESIDE)


def between(first: int, before: Array, last: int, behind: Array, at: int, max_gap: float) -> Array:
    """The same at one instant, from two states (n,) alone, at the stamps `first` and `last`, ns:
    the line between them; NaN outside and across a longer gap."""
    if at in (first, last):
        return before if at == first else behind
    gap = last - first
    if not first < at < last or gap > round(max_gap * SECOND):
        return np.full_like(before, np.nan)
    return before + (at - first) / gap * (behind - before)


def _cubic(
    stamp: NDArray[np.int64],
    joints: Array,
    gap: NDArray[np.int64],
    close: NDArray[np.bool_],
    at: NDArray[np.int64],
    i: NDArray[np.int64],
) -> Array:
    """The joints (K, n) at `at` (K,) between the states i (K,) and i + 1.

    q_i + u dq + u (1 - u) ((1 - u) (m_i h - dq) - u (m_i+1 h - dq)), with the slopes m: Hermite's.
    """
    step = joints[i + 1] - joints[i]
    width = gap[i].astype(np.float64)
    u = ((at - stamp[i]) / width)[:, None]

    def bend(
        beside: NDArray[np.int64], there: NDArray[np.bool_]
    ) -> tuple[Array, NDArray[np.bool_]]:
        """By how much (K, n) a neighbouring gap makes the step at its end another; which (K, 1)."""
        beside = np.where(there, beside, i)
        other = gap[beside].astype(np.float64)
        counts: NDArray[np.bool_] = (there & (other * EVEN >= width))[:, None]
        slope = (joints[beside + 1] - joints[beside]) / other[:, None]
        share = (width / (width + other))[:, None]
        return np.where(counts, share * (slope * width[:, None] - step), 0.0), counts

    left, has_left = bend(i - 1, close[i])
    right, has_right = bend(i + 1, close[i + 2])
    left = np.where(has_left, left, -right)
    right = np.where(has_right, right, -left)
    curved: Array = joints[i] + u * step + u * (1 - u) * ((1 - u) * left - u * right)
    return curved
