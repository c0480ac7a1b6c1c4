# SPDX-License-Identifier: Apache-2.0
"""Joints of one arm that come in several messages, put together by their stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.stamps import SECOND

FINE = 0.05  # s between two messages up to which the way between them is known


@dataclass(frozen=True)
class Part:
    """Messages with some of the joints: the `columns` (k,) that they are of all, message `number`
    (M,), `stamp` (M,), ns, and joints (M, k), rad."""

    columns: tuple[int, ...]
    number: NDArray[np.int64]
    stamp: NDArray[np.int64]
    joints: Array


def put_together(parts: Sequence[Part]) -> Part:
    """All joints at the stamps of the part that has the fewest messages, the others' on the line
    between their two messages around it; where these are too far apart nothing is known."""
    least = min(parts, key=lambda part: len(part.stamp))
    width = sum(len(part.columns) for part in parts)
    joints = np.full((len(least.stamp), width), np.nan)
    for part in parts:
        if part is least:
            joints[:, part.columns] = part.joints
            continue
        stamp, first = np.unique(part.stamp, return_index=True)
        if not len(stamp):
            continue
        after = np.clip(np.searchsorted(stamp, least.stamp), 0, len(stamp) - 1)
        before = np.maximum(after - 1, 0)
        exact = stamp[after] == least.stamp
        between = (stamp[before] < least.stamp) & (least.stamp < stamp[after])
        known = exact | (between & (stamp[after] - stamp[before] <= FINE * SECOND))
        # seconds from the first stamp: as floats, stamps of today are a quarter of a us coarse
        at, of = (least.stamp - stamp[0]) / SECOND, (stamp - stamp[0]) / SECOND
        for column, values in zip(part.columns, part.joints[first].T, strict=True):
            joints[known, column] = np.interp(at[known], of, values)
    whole = np.isfinite(joints).all(axis=1)
    return Part(tuple(range(width)), least.number[whole], least.stamp[whole], joints[whole])
