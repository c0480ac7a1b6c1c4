# SPDX-License-Identifier: Apache-2.0
"""Eq. 10's sums over measured points, by the parameters and by all targets and stations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import ParameterTable, turning_jacobian
from calib_solver.fitting import Quadratic
from calib_solver.points.places import TOLERANCE, Flange, Places, columns_of, motions
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.problem import (
    IntArray,
    Points,
    available,
    by_joint,
    posture_jacobian,
    raw_point_sums,
)

BLOCK = 1024  # points at a time: their Jacobians stay in cache
GROUPS = 256  # at a time: their sums take some MB
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
    flange: Flange | None = None,
) -> list[PointSums]:
    """The sums at all columns `full` (C,) and the places, one for each number of `folds` (N,) from
    0 on; one for all without. `flange` is that at `full`, where it is known. Memory does not grow
    with the points."""
    flange = Flange.of(problem, table, full) if flange is None else flange
    residuals = flange.residuals(problem, places)
    passed = accumulate_points_numpy
    if available(problem.arm.n, table):
        passed = accumulate_points_compiled
    return passed(problem, table, full, places, residuals, folds)


def accumulate_points_numpy(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    residuals: tuple[Array, Array],
    folds: IntArray | None = None,
) -> list[PointSums]:
    """In numpy alone: the twin that the compiled pass is tested against."""

    def slopes(rows: IntArray) -> Slopes:
        return point_slopes(problem, table, full, places, rows)

    return accumulate_points_by(problem, len(table.free_columns), residuals, slopes, folds)


def accumulate_points_compiled(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    residuals: tuple[Array, Array],
    folds: IntArray | None = None,
) -> list[PointSums]:
    """By the compiled pass, on all cores: independent of their number."""
    free = len(table.free_columns)
    fold = np.zeros(len(problem), dtype=np.int64) if folds is None else folds
    order = np.lexsort((fold, problem.part))
    start = _group_starts(problem.part[order], fold[order])
    weights = tuple(each[order] for each in _weights(problem))
    points = Points(
        problem.turned.take(order),
        problem.joints[order],
        start,
        places.target[problem.target[order]],
        weights[POSITION],
        residuals[POSITION][order],
        weights[TURN] if problem.has_orientation else None,
        residuals[TURN][order] if problem.has_orientation else None,
    )
    sums = [PointSums.zero(free + problem.places) for _ in range(int(fold.max(initial=0)) + 1)]
    for first in range(0, len(start) - 1, GROUPS):
        some = start[first : first + GROUPS + 1]
        found = raw_point_sums(replace(points, start=some), problem.arm, FLANGE, table, full)
        for kind, square in enumerate(found):
            if square is None:
                continue
            for row, whole in zip(order[some[:-1]], square, strict=True):
                _take(sums[fold[row]], kind, whole, own_columns(problem, free, problem.part[row]))
    trusted = problem.trust[:, None] * (np.stack(_weights(problem), axis=1) > 0)
    for number, one in enumerate(sums):
        one.count[:] = 3 * trusted[fold == number].sum(axis=0)
    return sums


def _group_starts(part: IntArray, fold: IntArray) -> IntArray:
    """Where (S + 1,) another part or fold of sorted rows begins, or a block of one is full."""
    changes = np.flatnonzero((np.diff(part) != 0) | (np.diff(fold) != 0)) + 1
    bounds = np.concatenate([[0], changes, [len(part)]])
    blocks = [np.arange(a, b, BLOCK) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]
    return np.concatenate([*blocks, [len(part)]]).astype(np.int64)


def _take(sums: PointSums, kind: int, whole: Array, own: IntArray) -> None:
    """Add J'J (D + 1, D + 1), whose last column are the residuals, at columns `own` (D,)."""
    sums.phi[kind] += whole[-1, -1]
    sums.gradient[kind][own] += whole[:-1, -1]
    sums.normal[kind][np.ix_(own, own)] += whole[:-1, :-1]


def own_columns(problem: PointProblem, free: int, part: int) -> IntArray:
    """The columns that a part's points have, of `free` parameters and of its places."""
    return np.concatenate([np.arange(free), free + columns_of(problem, part)])


def _weights(problem: PointProblem) -> tuple[Array, Array]:
    """Of every point's position and rotation (N,)."""
    return problem.trust * problem.weight, problem.trust * problem.oriented


def accumulate_points_by(
    problem: PointProblem,
    free: int,
    residuals: Slopes,
    slopes_of: Callable[[IntArray], Slopes],
    folds: IntArray | None = None,
) -> list[PointSums]:
    """The same by any F = `free` columns: `slopes_of` gives the Jacobians (R, 3, F + 12) of rows,
    by these and by their places, and `residuals` (N, 3) are those of all points. In blocks, so
    that memory does not grow with the points."""
    count = 1 if folds is None else int(folds.max(initial=0)) + 1
    sums = [PointSums.zero(free + problem.places) for _ in range(count)]
    for begin in range(0, len(problem), BLOCK):
        block = np.arange(begin, min(begin + BLOCK, len(problem)))
        slopes = slopes_of(block)
        for part in problem.parts_of(block):
            within = problem.part[block] == part
            own = own_columns(problem, free, part)
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
    for kind, weights in enumerate(_weights(problem)):
        slope, residual_of, weight = slopes[kind], residuals[kind], weights[rows]
        if slope is None or residual_of is None or not weight.any():
            continue
        root = np.sqrt(weight)
        flat = (root[:, None, None] * slope[taken]).reshape(-1, slope.shape[2])
        residual = (root[:, None] * residual_of[rows]).reshape(-1)
        sums.phi[kind] += residual @ residual
        sums.gradient[kind][own] += flat.T @ residual
        sums.normal[kind][np.ix_(own, own)] += flat.T @ flat
        sums.count[kind] += 3 * (problem.trust[rows] @ (weight > 0))
