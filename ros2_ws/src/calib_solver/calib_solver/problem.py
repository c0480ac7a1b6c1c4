# SPDX-License-Identifier: Apache-2.0
"""A measurement made ready for solving: poses sorted by sphere, certified distances listed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib_model.probing import Measurement, group_by_sphere
from calib_model.rotation import Array, frozen

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Problem:
    """N poses of S probed spheres, M certified distances.

    `keys` (S, 2) are location and sphere number; the poses of sphere s are rows `start[s]` to
    `start[s + 1]` of `joints` (N, n), columns of their `cosine` and `sine` (n, N) of direction * q,
    and rows of `centers` (N, 3), the sphere's centre in the probe frame; `weight` (N,) is 1 or
    less. `order` (N,) is each row's place in the measurement. `pairs` (M, 2) are rows of `keys`
    in one location and `nominal` (M,) the certificate's distance between them, m.
    """

    measured: Measurement
    keys: IntArray
    start: IntArray
    order: IntArray
    joints: Array
    cosine: Array
    sine: Array
    centers: Array
    weight: Array
    pairs: IntArray
    nominal: Array

    @classmethod
    def of(cls, measured: Measurement) -> Problem:
        """The problem of a measurement, every pose with weight 1.

        Raises:
            DataError: a pose does not fit the arm, the probe or the gauge.
        """
        poses = measured.checked().poses
        keys, row = group_by_sphere(poses.location, poses.sphere)
        order = np.argsort(row, kind='stable')
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(keys)))])
        joints = poses.joints[order]
        turned = measured.arm.direction * joints
        pairs = _pairs(keys)
        distances = [measured.gauge.distance(keys[i, 1], keys[j, 1]) for i, j in pairs]
        return cls(
            measured, keys, start.astype(np.int64), order, frozen(joints),
            frozen(np.cos(turned).T), frozen(np.sin(turned).T),
            frozen(measured.centers()[order]), frozen(np.ones(len(poses))), pairs,
            frozen(distances),
        )  # fmt: skip

    @property
    def counts(self) -> IntArray:
        """Poses of each sphere, shape (S,)."""
        return np.diff(self.start)

    @property
    def locations(self) -> list[IntArray]:
        """For each gauge location, the rows of `keys` probed there."""
        return [np.flatnonzero(self.keys[:, 0] == number) for number in np.unique(self.keys[:, 0])]

    def rows(self, sphere: int) -> slice:
        """The poses of the sphere in row `sphere` of `keys`."""
        return slice(int(self.start[sphere]), int(self.start[sphere + 1]))


def _pairs(keys: IntArray) -> IntArray:
    """Every two spheres of one location once: the terms of eq. 7 that are not null or twice."""
    pairs: list[tuple[int, int]] = []
    for location in np.unique(keys[:, 0]):
        pairs += combinations(map(int, np.flatnonzero(keys[:, 0] == location)), 2)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
