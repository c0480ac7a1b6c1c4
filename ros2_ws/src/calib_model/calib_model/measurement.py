# SPDX-License-Identifier: Apache-2.0
"""The probing set: which sphere was probed where, with which joints and which readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.errors import ContactError, DataError
from calib_model.instruments import (
    WHOLE_ROOM,
    ActiveProbe,
    Arm,
    Gauge,
    Probe,
    refuse_impossible,
    refuse_misfit,
)

#: a reading so many strokes out is in another unit; a stroke or two may be a wrong description
BEYOND_STROKE = 50
BEYOND_RAILS = 100.0  # m
BEYOND_TURNS = 1e4  # rad: no cable takes so many turns, and no cosine keeps its digits


@dataclass(frozen=True)
class ProbingSet:
    """N probing poses.

    `location` (N,) and `sphere` (N,) say what was probed, `joints` (N, n) in rad and
    `displacement` (N, 3) in m what was read (zeros for a passive probe), `stamp` (N,) in ns
    since the epoch when, `readings` (N,) how many probe readings were averaged.
    """

    location: NDArray[np.int64]
    sphere: NDArray[np.int64]
    joints: Array
    displacement: Array
    stamp: NDArray[np.int64]
    readings: NDArray[np.int64]

    def __post_init__(self) -> None:
        kinds = dict.fromkeys(('location', 'sphere', 'stamp', 'readings'), np.int64)
        for column in fields(self):
            values = np.array(getattr(self, column.name), dtype=kinds.get(column.name, np.float64))
            values.setflags(write=False)
            object.__setattr__(self, column.name, values)
        count = len(self.location)
        if any(len(getattr(self, column.name)) != count for column in fields(self)):
            raise DataError('the columns of a probing set differ in length')

    @classmethod
    def of(
        cls,
        location: Sequence[int] | NDArray[np.int64],
        sphere: Sequence[int] | NDArray[np.int64],
        joints: Array,
        displacement: Array | None = None,
    ) -> ProbingSet:
        """A set without stamps; `displacement` None for a passive probe."""
        count = len(location)
        return cls(
            np.asarray(location, dtype=np.int64),
            np.asarray(sphere, dtype=np.int64),
            joints,
            np.zeros((count, 3)) if displacement is None else displacement,
            np.arange(count, dtype=np.int64),
            np.ones(count, dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.location)

    @property
    def untold(self) -> NDArray[np.bool_]:
        """Which poses (N,) nobody has told the sphere of: location and sphere 0."""
        none: NDArray[np.bool_] = (self.location == 0) & (self.sphere == 0)
        return none

    def take(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> ProbingSet:
        """The poses of an index or mask array (N,), in its order."""
        return ProbingSet(*(getattr(self, column.name)[which] for column in fields(self)))

    @staticmethod
    def joined(sets: Sequence[ProbingSet]) -> ProbingSet:
        """All poses of several sets with the same number of joints."""
        if len({part.joints.shape[1] for part in sets}) > 1:
            raise DataError('probing sets of arms with different numbers of joints')
        columns = (column.name for column in fields(ProbingSet))
        return ProbingSet(*(np.concatenate([getattr(s, c) for s in sets]) for c in columns))


@dataclass(frozen=True)
class Measurement:
    """Everything a bag holds: the instruments' descriptions and the poses taken with them."""

    arm: Arm
    probe: Probe
    gauge: Gauge
    poses: ProbingSet
    source: str = 'measurement'

    def checked(self) -> Measurement:
        """Itself, when every pose fits the arm, the probe and the gauge.

        Raises:
            DataError: names the first pose that does not, or the description that cannot be.
        """
        poses = self.poses
        refuse_impossible(self.arm, self.probe, self.gauge, self.source)
        refuse_misfit(self.probe, self.gauge, WHOLE_ROOM)
        if len(poses) == 0:
            raise DataError(f'{self.source}: holds no probing poses')
        if poses.joints.ndim != 2 or poses.joints.shape[1] != self.arm.n:
            raise DataError(
                f'{self.source}: poses have {poses.joints.shape[-1]} joint positions, '
                f'the arm {self.arm.name} has {self.arm.n} joints'
            )
        self._refuse(~np.isfinite(poses.joints).all(axis=1), 'has a joint that is not finite')
        beyond, slides = np.abs(poses.joints) > BEYOND_TURNS, self.arm.prismatic
        self._refuse(beyond[:, ~slides].any(axis=1), f'has a joint beyond {BEYOND_TURNS:g} rad')
        slid = (np.abs(poses.joints[:, slides]) > BEYOND_RAILS).any(axis=1)
        self._refuse(slid, f'has a sliding joint beyond {BEYOND_RAILS:g} m: mm for m?')
        self._refuse(
            ~np.isfinite(poses.displacement).all(axis=1), 'has a reading that is no number'
        )
        if isinstance(self.probe, ActiveProbe):
            beyond = np.abs(poses.displacement) > BEYOND_STROKE * np.abs(self.probe.stroke).max()
            self._refuse(beyond.any(axis=1), 'has a reading far beyond the stroke: mm for m?')
        self._refuse(poses.untold, 'is of a sphere that nobody has told: identify sorts them')
        unknown = ~np.isin(poses.sphere, self.gauge.numbers)
        self._refuse(unknown, f'names a sphere that {self.gauge.name} does not have')
        self.centers()
        return self

    def centers(self) -> Array:
        """`p_probe_sphere` (N, 3) of every pose, m.

        Raises:
            DataError: names the first pose whose readings fit no sphere of the gauge.
        """
        try:
            return self.probe.centers(self.poses.displacement, self.gauge.sphere_diameter)
        except ContactError as error:
            raise DataError(f'{self.source}: {error}') from error

    def _refuse(self, bad: NDArray[np.bool_] | np.bool_, problem: str) -> None:
        if bad.any():
            row = int(np.argmax(bad))
            place = f'location {self.poses.location[row]}, sphere {self.poses.sphere[row]}'
            raise DataError(f'{self.source}: pose {row + 1} ({place}) {problem}')


def group_by_sphere(
    location: NDArray[np.int64], sphere: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The probed spheres, sorted: keys (S, 2) of location and sphere, and each pose's row (N,)."""
    # two short searches instead of one over rows, which numpy sorts as bytes
    locations, location_row = np.unique(location, return_inverse=True)
    spheres, sphere_row = np.unique(sphere, return_inverse=True)
    code = location_row * len(spheres) + sphere_row
    present = np.flatnonzero(np.bincount(code, minlength=len(locations) * len(spheres)))
    place = np.zeros(len(locations) * len(spheres), dtype=np.int64)
    place[present] = np.arange(len(present))
    keys = np.stack([locations[present // len(spheres)], spheres[present % len(spheres)]], axis=1)
    return keys, place[code]
