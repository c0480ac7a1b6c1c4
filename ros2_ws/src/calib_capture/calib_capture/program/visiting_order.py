# SPDX-License-Identifier: Apache-2.0
"""The order in which postures are visited, and the ways between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_capture.motion import FreePaths, travel_time
from calib_capture.program.candidates import Candidate
from calib_model.arrays import Array

STRAIGHT, DETOURS = 10, 3  # of the nearest postures are tried: straight, then by a detour


@dataclass(frozen=True)
class Visit:
    """Candidate `item` in its posture `which`, and the `way` (K + 1, n) to where its approach
    begins: from where, and what it goes by; empty where ways are nobody's concern."""

    item: int
    which: int
    way: Array


class VisitingOrder:
    """Takes an arm from posture to posture, always to the nearest one left that has a free way.

    Paths lead from where one approach begins to where the next begins. Without `ways` the arm goes
    straight from pose to pose, whatever is between.
    """

    def __init__(self, velocity: Array, ways: FreePaths | None, start: Array) -> None:
        self._velocity = velocity
        self._ways = ways
        self.here = start

    def visit(self, items: Sequence[Candidate]) -> list[Visit]:
        """Each once, but for those to which there is no free way."""
        if not items:
            return []
        choices = [each.postures if self._ways is None else each.ends for each in items]
        ends = np.concatenate(choices)
        item = np.repeat(np.arange(len(items)), [len(each) for each in choices])
        first = np.searchsorted(item, np.arange(len(items)))
        left = np.ones(len(ends), dtype=bool)
        visits: list[Visit] = []
        while left.any():
            seconds = np.where(left, travel_time(self.here, ends, self._velocity), np.inf)
            found = self._next(ends, np.argsort(seconds, kind='stable')[: left.sum()])
            if found is None:
                break
            row, way = found
            visits.append(Visit(int(item[row]), int(row - first[item[row]]), way))
            self.here = ends[row]
            left[item == item[row]] = False
        return visits

    def _next(self, ends: Array, nearest: NDArray[np.intp]) -> tuple[int, Array] | None:
        """The row of `ends` to go to and the way there."""
        ways = self._ways
        if ways is None:
            return int(nearest[0]), np.empty((0, ends.shape[1]))
        for row in nearest[:STRAIGHT]:
            if ways.free(self.here, ends[row]):
                return int(row), self.here[None]
        for row in nearest[:DETOURS]:
            between = ways.between(self.here, ends[row])
            if between is not None:
                return int(row), np.vstack([self.here, between])
        for row in nearest[STRAIGHT:]:
            if ways.free(self.here, ends[row]):
                return int(row), self.here[None]
        return None
