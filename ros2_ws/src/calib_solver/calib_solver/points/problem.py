# SPDX-License-Identifier: Apache-2.0
"""Measured points made ready for solving: sorted by target and station, with their weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError
from calib_model.instruments import Arm, PassiveProbe
from calib_model.kinematics import Parameter, ParameterTable, identifiable_table
from calib_model.measured_points import PointMeasurement
from calib_model.transforms import RigidTransform, quaternion_rotations
from calib_solver.problem import IntArray, Turned

#: more stations and targets than this are no measurement of one arm
MOST_PLACES = 300
#: points that place a station
FEWEST_POINTS = 3
#: reasons of probing, and what they are where targets are tracked
WORDS = {
    'no probing shows it': 'identified as the places of the stations',
    'the probe as its mount on the flange does': 'all targets as their places on the flange do',
    'identified as the mount': 'identified as those',
}
#: the flange itself: targets are placed beside the table of the arm's parameters
FLANGE = PassiveProbe('flange', RigidTransform())
#: a target somewhere: what points can tell is asked of a place that is no special one (m)
ANYWHERE = PassiveProbe('target', RigidTransform(np.array([0.13, 0.07, 0.19])))


@dataclass(frozen=True)
class PointProblem:
    """N points of K targets seen from S stations.

    `joints` (N, n); `position` (N, 3), m, and `rotation` (N, 3, 3) of the target in the tracker's
    frame, `oriented` (N,) 1 where the latter was measured, else 0; `target` and `station` (N,) are
    places in `targets` and `stations`. `weight` (N,) is that of a position by its stated sigma, 1
    on average, `trust` (N,) 1 or less, of the whole point; `turn_weight`, m^2/rad^2, is what a
    squared rotation counts beside a squared length. `order` (N,) is each row's place in the
    measurement; rows `parts[i]` to `parts[i + 1]` have one target and one station. A position of
    weight 1 has the stated sigma `unit_sigma`, m; 0 where none is stated.
    """

    measured: PointMeasurement
    targets: tuple[str, ...]
    stations: tuple[int, ...]
    target: IntArray
    station: IntArray
    order: IntArray
    parts: IntArray
    joints: Array
    position: Array
    rotation: Array
    oriented: Array
    weight: Array
    trust: Array
    turn_weight: float = 1.0
    unit_sigma: float = 0.0

    @classmethod
    def of(
        cls,
        measured: PointMeasurement,
        targets: Sequence[str] | None = None,
        stations: Sequence[int] | None = None,
    ) -> PointProblem:
        """The problem of a measurement, every point trusted; `targets` and `stations` are those to
        count with where they are known already.

        Raises:
            DataError: a point does not fit the arm, or there are too many stations.
        """
        points = measured.checked().points
        names = list(targets) if targets is not None else _sorted(set(points.target.tolist()))
        numbers = list(stations) if stations is not None else sorted(set(points.station.tolist()))
        if max(len(names), len(numbers)) > MOST_PLACES:
            raise DataError(
                f'{measured.source}: {len(names)} targets and {len(numbers)} stations, expected '
                f'{MOST_PLACES} at most'
            )
        target = np.array([names.index(name) for name in points.target.tolist()], dtype=np.int64)
        station = np.searchsorted(numbers, points.station).astype(np.int64)
        code = station * len(names) + target
        order = np.argsort(code, kind='stable')
        changes = np.flatnonzero(np.diff(code[order])) + 1
        oriented = points.oriented[order]
        turned = np.tile(np.eye(3), (len(points), 1, 1))
        turned[oriented] = quaternion_rotations(points.orientation[order][oriented])
        weight, unit_sigma = _weights(points.sigma[order])
        return cls(
            measured,
            tuple(names),
            tuple(map(int, numbers)),
            target[order],
            station[order],
            order,
            np.concatenate([[0], changes, [len(points)]]).astype(np.int64),
            frozen(points.joints[order]),
            frozen(points.position[order]),
            frozen(turned),
            frozen(oriented),
            frozen(weight),
            frozen(np.ones(len(points))),
            unit_sigma=unit_sigma,
        )

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def arm(self) -> Arm:
        """The arm that it starts from."""
        return self.measured.arm

    @property
    def has_orientation(self) -> bool:
        """Whether any point has one."""
        return bool(self.oriented.any())

    @cached_property
    def turned(self) -> Turned:
        """What the joints have turned and moved."""
        return Turned.of(self.arm, self.joints)

    @cached_property
    def part(self) -> IntArray:
        """Which part each row is of, shape (N,)."""
        return np.repeat(np.arange(len(self.parts) - 1), np.diff(self.parts))

    def parts_of(self, rows: IntArray) -> range:
        """The parts that a stretch of rows has points of."""
        return range(int(self.part[rows[0]]), int(self.part[rows[-1]]) + 1)

    @property
    def places(self) -> int:
        """Columns of all targets' and stations' places."""
        return 6 * (len(self.targets) + len(self.stations))

    @property
    def count(self) -> float:
        """Residuals, as far as their points are trusted."""
        return float(3 * (self.trust @ (1 + self.oriented)))

    def trusting(self, trust: Array) -> PointProblem:
        """The same with other trust (N,)."""
        return replace(self, trust=frozen(trust))

    def turns_weighing(self, turn_weight: float) -> PointProblem:
        """The same with another weight of rotations."""
        return replace(self, turn_weight=float(turn_weight))

    def weighed_as(self, unit_sigma: float) -> PointProblem:
        """With weight 1 for a position of this stated sigma, m, where sigmas are stated here and
        there."""
        if not unit_sigma or not self.unit_sigma:
            return self
        times = (unit_sigma / self.unit_sigma) ** 2
        return replace(self, weight=frozen(times * self.weight), unit_sigma=unit_sigma)

    def only(self, kept: NDArray[np.bool_]) -> PointProblem:
        """The points `kept` (N,), with all targets and stations, every one trusted."""
        code = self.station[kept] * len(self.targets) + self.target[kept]
        changes = np.flatnonzero(np.diff(code)) + 1
        return replace(
            self,
            target=self.target[kept],
            station=self.station[kept],
            order=self.order[kept],
            parts=np.concatenate([[0], changes, [int(kept.sum())]]).astype(np.int64),
            joints=frozen(self.joints[kept]),
            position=frozen(self.position[kept]),
            rotation=frozen(self.rotation[kept]),
            oriented=frozen(self.oriented[kept]),
            weight=frozen(self.weight[kept]),
            trust=frozen(np.ones(int(kept.sum()))),
        )

    def refuse_too_few(self) -> None:
        """Nothing, where every station has the points that place it.

        Raises:
            DataError: names one that has not.
        """
        for number, count in zip(self.stations, self._of_station(), strict=True):
            if count < FEWEST_POINTS:
                raise DataError(
                    f'{self.measured.source}: station {number} has {count} points, expected '
                    f'{FEWEST_POINTS} or more to place it by'
                )

    def _of_station(self) -> list[int]:
        counts: list[int] = np.bincount(self.station, minlength=len(self.stations)).tolist()
        return counts


def points_table(arm: Arm, fix: Sequence[str] = (), free: Sequence[str] = ()) -> ParameterTable:
    """The arm's parameters as far as points of targets can tell them: the targets' and stations'
    places are no part of it.

    Raises:
        DataError: a pattern matches no parameter.
    """
    table = identifiable_table(arm, ANYWHERE, fix, free)
    reason = 'the place of each target is found beside the parameters'
    table = table.frozen_at(table.matching('probe_*'), reason)
    return replace(table, parameters=tuple(map(_of_the_flange, table.parameters)))


def _of_the_flange(parameter: Parameter) -> Parameter:
    """With the probe's place that of the flange itself, and why it is held in words of points."""
    reason = parameter.reason
    for probing, tracking in WORDS.items():
        reason = reason.replace(probing, tracking)
    nominal = 0.0 if parameter.kind.startswith('probe_') else parameter.nominal
    return replace(parameter, reason=reason, nominal=nominal)


def _sorted(names: set[str]) -> list[str]:
    """By number where they are numbers."""
    return sorted(names, key=lambda name: (0, int(name), '') if _whole(name) else (1, 0, name))


def _whole(name: str) -> bool:
    return name.isascii() and name.isdecimal() and len(name) < 20


def _weights(sigma: Array) -> tuple[Array, float]:
    """1 / sigma^2, on average 1, and the sigma of a weight of 1; 0 where it is not stated."""
    if not (sigma > 0).all():
        return np.ones(len(sigma)), 0.0
    weight: Array = 1 / sigma**2
    mean = float(weight.mean())
    return weight / mean, mean**-0.5
