# SPDX-License-Identifier: Apache-2.0
"""How far predicted targets are from where the tracker saw them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array, median
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics import CorrectedArm, Correction
from calib_model.measured_points import PointMeasurement
from calib_model.transforms import nearest_rotation
from calib_solver.points.places import Flange, Places, best_places, squares, start_places
from calib_solver.points.problem import PointProblem, points_table

#: so many times the median, a point's weight falls off where gross errors may bend a fit
SOFT = 2.0
SOFT_ROUNDS = 5
#: nothing nearer than this (m, rad) is called a gross error, however good the rest
LEAST_SIZE = 1e-6


@dataclass(frozen=True)
class PointQuality:
    """Residuals of points, in the problem's order.

    `position` (N, 3), m, and `turn` (N, 3), rad, are predicted less measured in the base frame;
    `oriented` (N,) says which have the latter, `phi` is the weighted sum of squares, m^2, `places`
    are the targets and stations that were predicted with.
    """

    position: Array
    turn: Array
    oriented: Array
    phi: float
    places: Places

    @property
    def distance(self) -> Array:
        """Of each point from its prediction (N,), m."""
        away: Array = np.linalg.norm(self.position, axis=1)
        return away

    @property
    def angle(self) -> Array:
        """Of each orientation from its prediction (M,), rad, where there are any."""
        turned: Array = np.linalg.norm(self.turn[self.oriented > 0], axis=1)
        return turned


def flange_of(problem: PointProblem, arm: Arm, correction: Correction | None = None) -> Flange:
    """Where the flange is by an arm with all that is corrected beyond its parameters."""
    T_base_flange = CorrectedArm(arm, correction).forward(problem.joints)
    return Flange(T_base_flange[:, :3, :3], T_base_flange[:, :3, 3])


def assess_points(problem: PointProblem, flange: Flange, places: Places) -> PointQuality:
    """The quality with targets and stations where they are."""
    residuals = flange.residuals(problem, places)
    return PointQuality(*residuals, problem.oriented, squares(problem, residuals), places)


def fitted_quality(
    problem: PointProblem, arm: Arm, correction: Correction | None = None
) -> PointQuality:
    """The quality of an arm with the targets and stations that fit it best, little bent by gross
    errors."""
    table = points_table(arm)
    flange = flange_of(problem, arm, correction)
    places = best_places(problem, flange, start_places(problem, table, table.nominal))
    for _ in range(SOFT_ROUNDS):
        away, _turn = flange.residuals(problem, places)
        distance = np.linalg.norm(away, axis=1)
        out = distance / max(float(median(distance)), LEAST_SIZE)
        places = best_places(problem.trusting(soft_trust(out)), flange, places)
    return assess_points(problem, flange, places)


def soft_trust(out: Array) -> Array:
    """1, falling off beyond SOFT times the median: `out` (N,) is how many times it is."""
    trust: Array = 1 / (1 + np.maximum(out / SOFT - 1, 0.0) ** 2)
    return trust


@dataclass(frozen=True)
class HeldOutPoints:
    """Held-out points, and their quality with the parameters before and after; `corrected` is with
    the correction of eq. 12 too, where there is one."""

    problem: PointProblem
    initial: PointQuality
    identified: PointQuality
    corrected: PointQuality | None = None


def known_quality(
    problem: PointProblem, flange: Flange, known: Places, stations: tuple[int, ...]
) -> PointQuality:
    """With targets as they are `known`, and stations among `stations`, which `known` has; the
    others are placed by their own points."""
    places = Places.of(problem)
    rotation, translation = places.station_rotation.copy(), places.station.copy()
    new: list[int] = []
    for s, number in enumerate(problem.stations):
        if number in stations:
            row = stations.index(number)
            rotation[s], translation[s] = known.station_rotation[row], known.station[row]
        else:
            new.append(s)
    places = Places(rotation, translation, known.target_rotation, known.target)
    if new:
        places = _with_new_stations(problem, flange, places, new)
    return assess_points(problem, flange, places)


def _with_new_stations(
    problem: PointProblem, flange: Flange, places: Places, new: list[int]
) -> Places:
    """Each of some stations where its points fit best; targets and the others are held."""
    rotation, translation = places.station_rotation.copy(), places.station.copy()
    points = flange.points(problem, places)
    for s in new:
        rows = np.flatnonzero(problem.station == s)
        weight = problem.weight[rows] / problem.weight[rows].sum()
        here, there = weight @ points[rows], weight @ problem.position[rows]
        seen = weight[:, None] * (problem.position[rows] - there)
        rotation[s] = nearest_rotation(seen.T @ (points[rows] - here))
        translation[s] = there - rotation[s] @ here
    return replace(places, station_rotation=rotation, station=translation)


def refuse_unknown_targets(measured: PointMeasurement, targets: tuple[str, ...]) -> None:
    """Nothing, where all targets are among `targets`.

    Raises:
        DataError: names one that is not.
    """
    for name in sorted(set(measured.points.target.tolist())):
        if name not in targets:
            known = ', '.join(targets)
            raise DataError(
                f'{measured.source}: target {name} was not identified (there are {known})'
            )
