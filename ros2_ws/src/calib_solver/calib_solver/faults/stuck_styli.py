# SPDX-License-Identifier: Apache-2.0
"""Styli that do not move: one reading, exactly, from pose to pose while others move."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from calib_model.measurement import Measurement
from calib_solver.problem import IntArray, Problem

#: so many poses on end with the same reading of one stylus are no chance
FEWEST = 5
#: how far another stylus has to move meanwhile, m
MOVES = 1e-6
#: stretches are set apart as long as this share of the poses is left to judge them by
LEFT = 0.2


@dataclass(frozen=True)
class Stretch:
    """Poses `first` to `last`, from 1 in the measurement's order, with one `reading` (m) of a
    `stylus`, from 1, while others moved by `moved` (m)."""

    stylus: int
    first: int
    last: int
    reading: float
    moved: float

    @property
    def poses(self) -> slice:
        """Its rows in the measurement."""
        return slice(self.first - 1, self.last)

    def line(self, count: int) -> str:
        """What a user of `count` poses is told."""
        reads = f'stylus {self.stylus} reads {self.reading * 1e3:.4f} mm in'
        moved = f'while others move by {self.moved * 1e3:.4f} mm: stuck'
        if self.last - self.first + 1 == count:
            return f'{reads} every pose {moved}, or not connected'
        return f'{reads} poses {self.first} to {self.last} {moved}'


def stuck_stretches(measured: Measurement) -> tuple[Stretch, ...]:
    """Runs of at least FEWEST poses, in the measurement's order, with one reading of a stylus."""
    read = measured.poses.displacement
    found: list[Stretch] = []
    if not read.any():  # a passive probe has none
        return ()
    for stylus in range(read.shape[1]):
        starts = np.flatnonzero(np.diff(read[:, stylus], prepend=np.nan) != 0)
        lengths = np.diff(starts, append=len(read))
        for run in np.flatnonzero(lengths >= FEWEST):
            first, last = int(starts[run]), int(starts[run] + lengths[run])
            moved = float(np.ptp(np.delete(read[first:last], stylus, axis=1), axis=0).max())
            if moved > MOVES:
                reading = float(read[first, stylus])
                found.append(Stretch(stylus + 1, first + 1, last, reading, moved))
    return tuple(found)


def set_apart(problem: Problem, stretches: Iterable[Stretch]) -> IntArray:
    """For each pose (N,), in the problem's order, 0 or the number of its stretch, from 1; all 0
    where too few poses were left to judge the others by."""
    number_of = np.zeros(len(problem.order), dtype=np.int64)
    for number, stretch in enumerate(stretches, start=1):
        number_of[stretch.poses] = number
    if (number_of == 0).mean() < LEFT:
        number_of[:] = 0
    apart: IntArray = number_of[problem.order]
    return apart
