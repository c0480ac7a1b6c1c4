# SPDX-License-Identifier: Apache-2.0
"""Where an arm stood about the moment of a measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.stamps import SECOND

MOVES, MISSING = 'the arm moves', 'joint states are missing'


@dataclass(frozen=True)
class StandingSettings:
    """What counts as standing: no joint moves by more than `still` (rad, m) from `before` (s) a
    point's stamp to `after` it, and joint states come at least every `gap` (s)."""

    before: float = 0.3
    after: float = 0.1
    still: float = 5e-4
    gap: float = 0.1


def posture_at(
    at: int, stamp: NDArray[np.int64], joints: Array, asked: StandingSettings
) -> Array | str:
    """Where the arm stood (n,) about a moment `at`, ns, by joint states (M, n) at `stamp` (M,) in
    their order, or why that is not known."""
    begin, end = at - round(asked.before * SECOND), at + round(asked.after * SECOND)
    first, last = np.searchsorted(stamp, begin), np.searchsorted(stamp, end, 'right')
    if first == last:
        return MISSING
    # from the last one before to the first one behind
    rows = slice(max(int(first) - 1, 0), int(last) + 1)
    if stamp[rows][0] > begin or (np.diff(stamp[rows]) > asked.gap * SECOND).any():
        return MISSING
    if np.ptp(joints[rows], axis=0).max() > asked.still:
        return MOVES
    return np.asarray(joints[rows].mean(axis=0), dtype=np.float64)
