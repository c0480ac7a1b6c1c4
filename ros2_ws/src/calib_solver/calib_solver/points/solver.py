# SPDX-License-Identifier: Apache-2.0
"""Eq. 10 for measured points: the sums over all of them, targets and stations eliminated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import ParameterTable, turning_jacobian
from calib_solver.fitting import Minimiser, Quadratic
from calib_solver.points.places import (
    TOLERANCE,
    Flange,
    Places,
    best_places,
    columns_of,
    motions,
    start_places,
)
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.problem import IntArray, by_joint, posture_jacobian

BLOCK = 1024  # points at a time: their Jacobians stay in cache
POSITION, TURN = 0, 1  # which residuals
#: of positions and, where there are any, of rotations
Slopes = tuple[Array, Array | None]
#: m: coordinates of a tracker some metres off carry no more digits
ROUNDING = 2e-15


@dataclass(frozen=True)
class PointSums:
    """Sums over points by D = F + P columns, the free parameters' and the places': each array has
    those of positions (m^2) and of rotations (rad^2), in this order.

    `phi` (2,), `gradient` (2, D) and `normal` (2, D, D), J'r and J'J; `count` (2,) residuals.
    """

    phi: Array
    gradient: Array
    normal: Array
    count: Array

    @classmethod
    def zero(cls, size: int) -> PointSums:
        """Of no points, to be added to."""
        return cls(np.zeros(2), np.zeros((2, size)), np.zeros((2, size, size)), np.zeros(2))

    def __add__(self, other: PointSums) -> PointSums:
        return PointSums(*(getattr(self, name) + getattr(other, name) for name in vars(self)))

    def __sub__(self, other: PointSums) -> PointSums:
        return PointSums(*(getattr(self, name) - getattr(other, name) for name in vars(self)))

    def only(self, columns: IntArray) -> PointSums:
        """By some of the columns."""
        return PointSums(
            self.phi,
            self.gradient[:, columns],
            self.normal[:, columns[:, None], columns],
            self.count,
        )

    def weighed(self, turn_weight: float) -> Quadratic:
        """Both kinds of residuals as one objective of all columns, m^2."""
        weight = np.array([1.0, turn_weight])
        return Quadratic(
            float(weight @ self.phi),
            weight @ self.gradient,
            np.einsum('w,wij->ij', weight, self.normal),
            float(self.count @ (weight > 0)),
        )


def eliminated(whole: Quadratic, free: int) -> tuple[Quadratic, int]:
    """The objective of the first `free` columns with the others at their best (Schur complement),
    and how many of these are told."""
    values, vectors = np.linalg.eigh(whole.normal[free:, free:])
    kept = values > TOLERANCE * values.max(initial=1e-300)
    half = vectors[:, kept] / np.sqrt(values[kept])
    coupling = whole.normal[:free, free:] @ half
    pull = half.T @ whole.gradient[free:]
    told = int(kept.sum())
    return Quadratic(
        max(whole.phi - float(pull @ pull), 0.0),
        whole.gradient[:free] - coupling @ pull,
        whole.normal[:free, :free] - coupling @ coupling.T,
        whole.terms - told,
        rounding=2 * float(np.sqrt(max(whole.phi, 0.0))) * ROUNDING,
    ), told


def accumulate_points(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    folds: IntArray | None = None,
) -> list[PointSums]:
    """The sums at all columns `full` (C,) and the places, one for each number of `folds` (N,) from
    0 on; one for all without. In blocks, so that memory does not grow with the points."""
    residuals = Flange.of(problem, table, full).residuals(problem, places)
    free = len(table.free_columns)

    def slopes(rows: IntArray) -> Slopes:
        return point_slopes(problem, table, full, places, rows)

    return accumulate_points_by(problem, free, residuals, slopes, folds)


def accumulate_points_by(
    problem: PointProblem,
    free: int,
    residuals: Slopes,
    slopes_of: Callable[[IntArray], Slopes],
    folds: IntArray | None = None,
) -> list[PointSums]:
    """The same by any F = `free` columns: `slopes_of` gives the Jacobians (R, 3, F + 12) of rows,
    by these and by their places, and `residuals` (N, 3) are those of all points."""
    count = 1 if folds is None else int(folds.max(initial=0)) + 1
    sums = [PointSums.zero(free + problem.places) for _ in range(count)]
    for begin in range(0, len(problem), BLOCK):
        block = np.arange(begin, min(begin + BLOCK, len(problem)))
        slopes = slopes_of(block)
        for part in problem.parts_of(block):
            within = problem.part[block] == part
            own = np.concatenate([np.arange(free), free + columns_of(problem, part)])
            for number in range(count):
                taken = np.flatnonzero(
                    within if folds is None else within & (folds[block] == number)
                )
                _add(sums[number], problem, block[taken], own, residuals, slopes, taken)
    return sums


def point_slopes(
    problem: PointProblem, table: ParameterTable, full: Array, places: Places, rows: IntArray
) -> Slopes:
    """Jacobians (R, 3, F + 12) of rows, by the places of their own targets and stations: of
    positions, and of rotations if there are."""
    arm, _ = table.apply(full, problem.arm, FLANGE)
    joints, centers = problem.joints[rows], places.target[problem.target[rows]]
    points, by_parameter = posture_jacobian(arm, FLANGE, table, full, joints, centers)
    # at the flange itself the three columns of a probe's place are the flange's axes
    rotation = by_parameter[:, :, table.mount][:, :, :3]
    moved, turned = motions(rotation, points)
    position = np.concatenate([by_parameter[:, :, table.free_columns], moved], axis=2)
    if not problem.oriented[rows].any():
        return position, None
    by_angle = turning_slopes(table, arm, full, joints)
    return position, np.concatenate([by_angle[:, :, table.free_columns], turned], axis=2)


def turning_slopes(table: ParameterTable, arm: Arm, full: Array, joints: Array) -> Array:
    """How the flange turns with every column of the table (R, 3, C), rad, where the encoders of
    `arm`, that of all columns `full` (C,), read `joints` (R, n)."""
    by_angle = np.zeros((len(joints), 3, len(full)))
    errors = table.joint_errors(full)
    if errors is None:
        by_angle[:, :, : table.mount.start] = turning_jacobian(arm, joints)
        return by_angle
    basis = errors.terms.basis(arm, joints)
    turns = turning_jacobian(arm, joints + errors.angles(arm, joints))
    terms = by_joint(table, arm, turns)[:, :, None, :] * basis[:, None, :, :]
    by_angle[:, :, : table.mount.start] = turns
    by_angle[:, :, table.mount.stop :] = terms.reshape(len(joints), 3, -1)
    return by_angle


def padded(information: Array, places: int) -> Array:
    """With nothing known of places."""
    return np.concatenate([information, np.zeros(places)])


def _add(
    sums: PointSums,
    problem: PointProblem,
    rows: IntArray,
    own: IntArray,
    residuals: Slopes,
    slopes: Slopes,
    taken: IntArray,
) -> None:
    weights = (
        problem.trust[rows] * problem.weight[rows],
        problem.trust[rows] * problem.oriented[rows],
    )
    for kind in (POSITION, TURN):
        slope, residual_of, weight = slopes[kind], residuals[kind], weights[kind]
        if slope is None or residual_of is None or not weight.any():
            continue
        root = np.sqrt(weight)
        flat = (root[:, None, None] * slope[taken]).reshape(-1, slope.shape[2])
        residual = (root[:, None] * residual_of[rows]).reshape(-1)
        sums.phi[kind] += residual @ residual
        sums.gradient[kind][own] += flat.T @ residual
        sums.normal[kind][np.ix_(own, own)] += flat.T @ flat
        sums.count[kind] += 3 * (problem.trust[rows] @ (weight > 0))


class PlacedQuadratic:
    """Eq. 10 of a problem by all columns of a table, `places` at their best for the last ones."""

    def __init__(self, problem: PointProblem, table: ParameterTable, places: Places) -> None:
        self.problem, self.table, self.places = problem, table, places

    def at(self, full: Array) -> Quadratic:
        """The objective of the free columns at `full` (C,)."""
        flange = Flange.of(self.problem, self.table, full)
        self.places = best_places(self.problem, flange, self.places)
        (sums,) = accumulate_points(self.problem, self.table, full, self.places)
        free = len(self.table.free_columns)
        return eliminated(sums.weighed(self.problem.turn_weight), free)[0]


@dataclass(frozen=True)
class PointSolver(Minimiser[PointProblem]):
    """Eq. 10 with targets and stations at their best for whatever parameters of the arm."""

    @property
    def needed(self) -> str:
        """What the objective takes at least, in words."""
        return 'it needs more points than targets and stations take up'

    @cached_property
    def _places(self) -> list[Places]:
        """Where targets and stations were last: the next best is near."""
        return []

    def begin_at(self, places: Places) -> None:
        """Look for targets and stations from there on."""
        self._places[:] = [places]

    def places(self, problem: PointProblem, x: Array) -> Places:
        """The best places at offsets x (F,)."""
        full = self.full(x)
        if not self._places:
            self.begin_at(start_places(problem, self.table, full))
        found = best_places(problem, Flange.of(problem, self.table, full), self._places[0])
        self.begin_at(found)
        return found

    def value(self, problem: PointProblem, x: Array) -> Quadratic:
        """Eq. 10 at offsets x (F,)."""
        (sums,) = accumulate_points(problem, self.table, self.full(x), self.places(problem, x))
        return eliminated(sums.weighed(problem.turn_weight), len(x))[0]
