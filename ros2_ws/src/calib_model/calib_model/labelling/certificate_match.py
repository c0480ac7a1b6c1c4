# SPDX-License-Identifier: Apache-2.0
"""Which spheres of a certificate seen centres can be: by their distances, as one rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Gauge
from calib_model.transforms import nearest_rotation

MOST = 5000  # matches that are followed up: a plate of many equal squares has more than enough


@dataclass(frozen=True)
class Match:
    """Sphere numbers of the centres, in their order, and how far the worst is off, m."""

    numbers: tuple[int, ...]
    off: float


class Certificate:
    """A gauge's centres to be found again; `only` the spheres that were probed, where known."""

    def __init__(self, gauge: Gauge, only: tuple[int, ...] = ()) -> None:
        self.gauge = gauge
        self.numbers = tuple(number for number in gauge.numbers if not only or number in only)
        self.centers = np.array([gauge.center(number) for number in self.numbers]).reshape(-1, 3)
        apart = self.centers[:, None] - self.centers[None]
        self.distances: Array = np.linalg.norm(apart, axis=2)
        nearest = self.distances[~np.eye(len(self.numbers), dtype=np.bool_)]
        self.pitch = float(nearest.min()) if len(nearest) else np.inf

    def matches(self, seen: Array, tolerance: float) -> list[Match]:
        """Every way in which centres (k, 3) can be spheres of it, each within `tolerance` (m) of
        its place once the certificate lies best; the best first."""
        apart = np.linalg.norm(seen[:, None] - seen[None], axis=2)
        partial: list[tuple[int, ...]] = [()]
        for i in range(len(seen)):
            partial = [
                (*before, candidate)
                for before in partial
                for candidate in self._candidates(before, apart[i, :i], 2 * tolerance)
            ][:MOST]
        found = [
            Match(tuple(self.numbers[j] for j in rows), off)
            for rows in partial
            if (off := self._off(seen, list(rows))) <= tolerance
        ]
        return sorted(found, key=lambda match: match.off)

    def _candidates(self, before: tuple[int, ...], seen: Array, tolerance: float) -> list[int]:
        """Rows that are as far from those `before` (i,) as was `seen` (i,)."""
        near = np.abs(self.distances[:, list(before)] - seen) <= tolerance
        free = np.setdiff1d(np.flatnonzero(near.all(axis=1)), before)
        return [int(row) for row in free]

    def _off(self, seen: Array, rows: list[int]) -> float:
        """How far the worst centre (k, 3) is from the certificate laid over them (Kabsch), m."""
        certified = self.centers[rows] - self.centers[rows].mean(axis=0)
        around = seen - seen.mean(axis=0)
        rotation = nearest_rotation(around.T @ certified)
        return float(np.linalg.norm(around - certified @ rotation.T, axis=1).max())

    def nearest_distance(self, seen: float) -> float:
        """The certified distance that a seen one (m) comes closest to."""
        every = self.distances[np.triu_indices(len(self.numbers), 1)]
        return float(every[np.argmin(np.abs(every - seen))]) if len(every) else np.nan
