# SPDX-License-Identifier: Apache-2.0
"""Targets on the flange as a tracker measured them: which one, from where, with which joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import Arm

FARTHEST = 1e3  # m from the tracker
BEYOND_TURNS = 1e4  # rad: no cable takes so many turns, and no cosine keeps its digits
UNIT = 1e-3  # a quaternion's length is 1 to this


@dataclass(frozen=True)
class PointSet:
    """N measured points.

    `target` (N,) are names, `station` (N,) numbers of the tracker's place; `joints` (N, n) in rad
    (m where prismatic), `position` (N, 3) in m and `orientation` (N, 4), unit quaternions x y z w
    or zeros, say where the target was in the tracker's frame; `sigma` (N,) in m is the standard
    uncertainty of a coordinate, 0 where it is not given; `stamp` (N,) in ns since the epoch.
    """

    target: NDArray[np.str_]
    station: NDArray[np.int64]
    joints: Array
    position: Array
    orientation: Array
    sigma: Array
    stamp: NDArray[np.int64]

    def __post_init__(self) -> None:
        kinds = {'target': np.str_, 'station': np.int64, 'stamp': np.int64}
        for column in fields(self):
            values: NDArray[Any] = np.array(
                getattr(self, column.name), dtype=kinds.get(column.name, np.float64), order='C'
            )
            values.setflags(write=False)
            object.__setattr__(self, column.name, values)
        if any(len(getattr(self, column.name)) != len(self.target) for column in fields(self)):
            raise DataError('the columns of a set of points differ in length')

    @classmethod
    def of(
        cls,
        joints: Array,
        position: Array,
        orientation: Array | None = None,
        target: Sequence[str] | None = None,
        station: Sequence[int] | NDArray[np.int64] | None = None,
        sigma: Array | None = None,
    ) -> PointSet:
        """A set without stamps; one target, one station and equal weights unless they are given."""
        count = len(position)
        return cls(
            np.array(target if target is not None else ['1'] * count),
            np.asarray(station if station is not None else np.ones(count), dtype=np.int64),
            joints,
            position,
            np.zeros((count, 4)) if orientation is None else orientation,
            np.zeros(count) if sigma is None else sigma,
            np.arange(count, dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.target)

    @property
    def oriented(self) -> NDArray[np.bool_]:
        """Which points have an orientation, shape (N,)."""
        return np.asarray(self.orientation.any(axis=1), dtype=np.bool_)

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> PointSet:
        """The points of an index or mask array (N,), in its order."""
        return PointSet(*(getattr(self, column.name)[which] for column in fields(self)))

    @staticmethod
    def joined(sets: Sequence[PointSet]) -> PointSet:
        """All points of several sets with the same number of joints."""
        if len({part.joints.shape[1] for part in sets}) > 1:
            raise DataError('points of arms with different numbers of joints')
        columns = (column.name for column in fields(PointSet))
        return PointSet(*(np.concatenate([getattr(s, c) for s in sets]) for c in columns))


@dataclass(frozen=True)
class PointMeasurement:
    """An arm and the points of its targets; no gauge, no probe."""

    arm: Arm
    points: PointSet
    source: str = 'points'
    kind: str = field(default='points', init=False)

    def checked(self) -> PointMeasurement:
        """Itself, when every point fits the arm.

        Raises:
            DataError: names the first point that does not.
        """
        points = self.points
        if len(points) == 0:
            raise DataError(f'{self.source}: holds no measured points')
        if points.joints.ndim != 2 or points.joints.shape[1] != self.arm.n:
            raise DataError(
                f'{self.source}: points have {points.joints.shape[-1]} joint positions, '
                f'the arm {self.arm.name} has {self.arm.n} joints'
            )
        self._refuse(~np.isfinite(points.joints).all(axis=1), 'has a joint that is not finite')
        turned = (np.abs(points.joints) > BEYOND_TURNS).any(axis=1)
        self._refuse(turned, f'has a joint beyond {BEYOND_TURNS:g} rad')
        self._refuse(~np.isfinite(points.position).all(axis=1), 'has no finite position')
        far = (np.abs(points.position) > FARTHEST).any(axis=1)
        self._refuse(far, f'is over {FARTHEST:g} m from the tracker: is it in mm?')
        length = np.linalg.norm(points.orientation, axis=1)
        turn = points.oriented & ~(np.abs(length - 1) < UNIT)
        self._refuse(turn, 'has an orientation that is no unit quaternion')
        self._refuse(~(points.sigma >= 0) | (points.sigma > FARTHEST), 'has no usable sigma')
        given = points.sigma > 0
        if given.any():
            self._refuse(~given, 'has no sigma, while others have one')
        self._refuse(points.station < 1, 'has no station number from 1 on')
        self._refuse(points.target == '', 'names no target')
        return self

    def _refuse(self, bad: NDArray[np.bool_] | np.bool_, problem: str) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            place = f'target {self.points.target[row]}, station {self.points.station[row]}'
            raise DataError(f'{self.source}: point {row + 1} ({place}) {problem}')
