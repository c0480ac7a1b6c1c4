# SPDX-License-Identifier: Apache-2.0
"""The order in which postures are visited."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_model.rotation import Array


def travel_time(start: Array, goals: Array, velocity: Array) -> Array:
    """Seconds (K,) from posture `start` (n,) to `goals` (K, n) at the joints' speeds (n,)."""
    finite = np.where(np.isfinite(velocity), velocity, 1.0)
    seconds: Array = np.max(np.abs(goals - start) / finite, axis=1)
    return seconds


def short_order(
    start: Array, choices: Sequence[Array], velocity: Array
) -> list[tuple[int, int]]:
    """Visit each of `choices` once, always the nearest left: pairs (item, which of its postures).

    An item (K, n) is one posture written in K ways, full turns apart.
    """
    if not choices:
        return []
    postures = np.concatenate(choices)
    item = np.repeat(np.arange(len(choices)), [len(each) for each in choices])
    first = np.searchsorted(item, np.arange(len(choices)))
    left = np.ones(len(postures), dtype=bool)
    order: list[tuple[int, int]] = []
    here = start
    for _ in choices:
        seconds = np.where(left, travel_time(here, postures, velocity), np.inf)
        nearest = int(np.argmin(seconds))
        here = postures[nearest]
        left[item == item[nearest]] = False
        order.append((int(item[nearest]), nearest - int(first[item[nearest]])))
    return order
