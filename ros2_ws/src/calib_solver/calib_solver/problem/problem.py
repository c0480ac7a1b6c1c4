# SPDX-License-Identifier: Apache-2.0
"""A measurement made ready for solving: poses sorted by sphere, certified distances listed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen, read_only
from calib_model.instruments import Arm
from calib_model.measurement import Measurement, group_by_sphere

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Turned:
    """Postures as the passes take them: `cosine` and `sine` (n, N) of what each joint has turned,
    `slide` (P, N), what each of the P prismatic ones has moved (m)."""

    cosine: Array
    sine: Array
    slide: Array

    @classmethod
    def of(cls, arm: Arm, joints: Array) -> Turned:
        """Of postures (N, n)."""
        moved = frozen((arm.direction * arm.uncoupled(joints)).T)
        turned = np.where(arm.prismatic[:, None], 0.0, moved) if arm.prismatic.any() else moved
        slide = moved[arm.prismatic]
        return cls(read_only(np.cos(turned)), read_only(np.sin(turned)), read_only(slide))

    def take(self, rows: IntArray) -> Turned:
        """Of some of the postures."""
        parts = (self.cosine, self.sine, self.slide)
        return Turned(*(np.ascontiguousarray(part[:, rows]) for part in parts))


@dataclass(frozen=True)
class Problem:
    """N poses of S probed spheres, M certified distances.

    `keys` (S, 2) are location and sphere number; the poses of sphere s are rows `start[s]` to
    `start[s + 1]` of `joints` (N, n), columns of the `cosine` and `sine` (n, N) of what each joint
    has turned, of `slide` (P, N), what each of the P prismatic ones has moved (m), and rows of
    `centers` (N, 3), the sphere's centre in the probe frame; `weight` (N,) is 1 or less. `order`
    (N,) is each row's place in the measurement. `placement` (S,) numbers where the gauge stood:
    spheres of one location share it unless the gauge was found to have moved.
    `pairs` (M, 2) are rows of `keys` with one placement, `nominal` (M,) the certificate's distance
    between them, m, and `pair_weight` (M,) 1 or less.
    """

    measured: Measurement
    keys: IntArray
    start: IntArray
    order: IntArray
    joints: Array
    cosine: Array
    sine: Array
    slide: Array
    centers: Array
    weight: Array
    placement: IntArray
    pairs: IntArray
    nominal: Array
    pair_weight: Array

    @classmethod
    def of(
        cls, measured: Measurement, placement: Mapping[tuple[int, int], int] | None = None
    ) -> Problem:
        """The problem of a measurement, every pose and distance with weight 1.

        `placement` gives spheres (location, sphere) that stood elsewhere than the others of
        their location a number, the same for those that stood together.

        Raises:
            DataError: a pose does not fit the arm, the probe or the gauge.
        """
        poses = measured.checked().poses
        keys, row = group_by_sphere(poses.location, poses.sphere)
        order = np.argsort(row, kind='stable')
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=len(keys)))])
        joints = poses.joints[order]
        turned = Turned.of(measured.arm, joints)
        placed = _placements(keys, placement or {})
        pairs = _pairs(placed)
        distances = [measured.gauge.distance(keys[i, 1], keys[j, 1]) for i, j in pairs]
        return cls(
            measured,
            keys,
            start.astype(np.int64),
            order,
            frozen(joints),
            turned.cosine,
            turned.sine,
            turned.slide,
            frozen(measured.centers()[order]),
            frozen(np.ones(len(poses))),
            placed,
            pairs,
            frozen(distances),
            frozen(np.ones(len(pairs))),
        )

    @property
    def counts(self) -> IntArray:
        """Poses of each sphere, shape (S,)."""
        return np.diff(self.start)

    @property
    def placements(self) -> list[IntArray]:
        """For each placement of the gauge, the rows of `keys` probed there."""
        return [np.flatnonzero(self.placement == number) for number in np.unique(self.placement)]

    @property
    def locations(self) -> list[IntArray]:
        """For each gauge location, the rows of `keys` probed there."""
        return [np.flatnonzero(self.keys[:, 0] == number) for number in np.unique(self.keys[:, 0])]

    def rows(self, sphere: int) -> slice:
        """The poses of the sphere in row `sphere` of `keys`."""
        return slice(int(self.start[sphere]), int(self.start[sphere + 1]))


def _placements(keys: IntArray, moved: Mapping[tuple[int, int], int]) -> IntArray:
    """A number for each sphere's placement (S,): one a location, further ones for what moved."""
    named = [(int(key[0]), moved.get((int(key[0]), int(key[1])), 0)) for key in keys]
    numbers = {name: number for number, name in enumerate(sorted(set(named)))}
    return np.array([numbers[name] for name in named], dtype=np.int64)


def _pairs(placement: IntArray) -> IntArray:
    """Every two spheres of one placement once: eq. 7's terms that are neither null nor twice."""
    pairs: list[tuple[int, int]] = []
    for number in np.unique(placement):
        pairs += combinations(map(int, np.flatnonzero(placement == number)), 2)
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
