# SPDX-License-Identifier: Apache-2.0
"""What makes measured points scatter: the tracker, every coordinate of a target and station alike,
and the arm's joints, each point as far as they move it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting import PoseNoise, full_inverse, variances_of
from calib_solver.points.part_noise import part_factors
from calib_solver.points.places import Places
from calib_solver.points.point_sums import (
    BLOCK,
    POSITION,
    TURN,
    PointSums,
    Slopes,
    own_columns,
    padded,
    point_slopes,
    turning_slopes,
)
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.points.quality import PointQuality
from calib_solver.problem import IntArray, by_joint, posture_jacobian

#: rounds of telling parts that scatter more from joints that do
PART_ROUNDS = 4


@dataclass(frozen=True)
class PointNoise:
    """Variances of a position of weight 1 and of the joints, `poses`, and of a rotation about each
    axis, `turn`, rad^2, beyond what the joints do to it.

    `point_factors` and `turn_factors` (P,) are how many times these each part of the problem has,
    points of one target and station.
    """

    poses: PoseNoise
    turn: float
    point_factors: Array
    turn_factors: Array

    def scatter(self, problem: PointProblem) -> tuple[tuple[str, int, float], ...]:
        """Each target and station of a problem, and how many times the variance of a position its
        points have; none where all scatter alike."""
        if (self.point_factors == 1).all():
            return ()
        first = problem.parts[:-1]
        names = [problem.targets[k] for k in problem.target[first]]
        numbers = [problem.stations[s] for s in problem.station[first]]
        return tuple(zip(names, numbers, self.point_factors.tolist(), strict=True))


def moved_by_joints(
    problem: PointProblem, table: ParameterTable, full: Array, places: Places, rows: IntArray
) -> tuple[Array, Array]:
    """How the targets of some rows move and turn with the joints' readings (R, 3, n), m/rad (m/m)
    and rad/rad, in the base frame."""
    arm, _ = table.apply(full, problem.arm, FLANGE)
    joints, centers = problem.joints[rows], places.target[problem.target[rows]]
    _, jacobian = posture_jacobian(arm, FLANGE, table, full, joints, centers)
    turning = turning_slopes(table, arm, full, joints)
    # a joint that slides turns nothing
    turned = np.where(arm.prismatic, 0.0, by_joint(table, arm, turning))
    return arm.by_positions(by_joint(table, arm, jacobian)), arm.by_positions(turned)


def point_noise(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    quality: PointQuality,
    sums: PointSums,
    prior: Array,
    variance: float,
) -> PointNoise:
    """The variances that explain the squared residuals of a fit.

    `sums` are those there, `prior` (F,), m^2, is what it weighs; `variance` (m^2) is what all
    coordinates have on average. A fit leaves less of what moves it much: what is expected of each
    residual is reckoned through it.
    """
    n, whole = problem.arm.n, sums.weighed(problem.turn_weight).normal
    inverse, rank = full_inverse(whole + np.diag(padded(prior, problem.places)))
    freedom = int((problem.count - rank) * 3 * len(problem) / problem.count)  # of positions
    turn = variance / problem.turn_weight if problem.has_orientation else 0.0
    alike: Array = np.ones(len(problem.parts) - 1)
    plain = PointNoise(PoseNoise(variance, np.zeros(n), max(freedom, 0)), turn, alike, alike)
    if freedom < 1:
        return plain
    slopes = _Slopes(problem, table, full, quality.places)
    expected = _expected(slopes, sums, inverse)
    found, factors, turn_factors = _by_part(problem, quality, expected)
    if not found.any():
        return plain
    worth = _worth(
        problem, slopes.moved(), found[:-1], expected[POSITION].reshape(-1, n + 2)[:, :-1]
    )
    poses = PoseNoise(float(found[0]), found[1:-1], min(worth, freedom))
    return PointNoise(poses, float(found[-1]), factors, turn_factors)


def _by_part(
    problem: PointProblem, quality: PointQuality, expected: Array
) -> tuple[Array, Array, Array]:
    """The variances (1 + n + 1,) that explain squared residuals, and how many times the first and
    the last of them each part has; `expected` (2, N, 3, 1 + n + 1) as `_expected`."""
    count, rows = len(problem.parts) - 1, problem.oriented > 0
    part = (np.repeat(problem.part, 3), np.repeat(problem.part[rows], 3))
    scale = (np.repeat(problem.weight, 3), np.ones(3 * int(rows.sum())))
    squares = [quality.position.reshape(-1) ** 2, quality.turn[rows].reshape(-1) ** 2]
    plain = [each.reshape(-1, each.shape[-1]) for each in (expected[0], expected[1][rows])]
    own, column = [each.copy() for each in plain], (0, -1)
    factors: list[Array] = [np.ones(count), np.ones(count)]
    for _ in range(PART_ROUNDS):
        # rotations weigh as they do in the fit: all in m^2
        worth = (1.0, problem.turn_weight)
        found = variances_of(
            np.concatenate([w * each for w, each in zip(worth, squares, strict=True)]),
            np.concatenate([w * each for w, each in zip(worth, own, strict=True)]),
        )
        if count == 1:
            break
        for kind in (POSITION, TURN) if rows.any() else (POSITION,):
            at = column[kind]
            others = own[kind] @ found - own[kind][:, at] * found[at]
            beyond = scale[kind] * np.maximum(squares[kind] - others, 0.0)
            left = scale[kind] * plain[kind][:, at]
            factors[kind] = part_factors(part[kind], count, beyond, left)
            own[kind][:, at] = factors[kind][part[kind]] * plain[kind][:, at]
        if all((each == 1).all() for each in factors):
            break
    return found, factors[POSITION], factors[TURN]


@dataclass(frozen=True)
class _Stretch:
    """`rows` (R,) of one part and their `columns` (d,): the Jacobians (R, 3, d) of positions and,
    where there are any, of rotations, how these go with the joints' readings (R, 3, n), and how
    the `gradient` does (R, n, d)."""

    rows: IntArray
    columns: IntArray
    slopes: Slopes
    moved: tuple[Array, Array]
    gradient: Array


@dataclass(frozen=True)
class _Slopes:
    """How the points of a fit go with its columns, and with what makes them scatter."""

    problem: PointProblem
    table: ParameterTable
    full: Array
    places: Places

    def by_part(self) -> Iterator[_Stretch]:
        """All points, some of one part at a time."""
        problem, free = self.problem, len(self.table.free_columns)
        for begin in range(0, len(problem), BLOCK):
            block = np.arange(begin, min(begin + BLOCK, len(problem)))
            given = (problem, self.table, self.full, self.places, block)
            position, turn = point_slopes(*given)
            moved, turned = moved_by_joints(*given)
            weight = problem.trust[block] * problem.weight[block]
            gradient = np.einsum('n,nkd,nkj->njd', weight, position, moved, optimize=True)
            if turn is not None:
                weight = problem.turn_weight * problem.trust[block] * problem.oriented[block]
                gradient += np.einsum('n,nkd,nkj->njd', weight, turn, turned, optimize=True)
            for part in problem.parts_of(block):
                own = problem.part[block] == part
                yield _Stretch(
                    block[own],
                    own_columns(problem, free, part),
                    (position[own], turn[own] if turn is not None else None),
                    (moved[own], turned[own]),
                    gradient[own],
                )

    def normals(self, point_factors: Array, turn_factors: Array) -> tuple[Array, Array]:
        """J'J (D, D) of positions and of rotations, each part so many times."""
        problem, free = self.problem, len(self.table.free_columns)
        size = free + problem.places
        found = np.zeros((2, size, size))
        for begin in range(0, len(problem), BLOCK):
            block = np.arange(begin, min(begin + BLOCK, len(problem)))
            slopes = point_slopes(problem, self.table, self.full, self.places, block)
            weights = (problem.weight[block], problem.oriented[block])
            for part in problem.parts_of(block):
                own = np.flatnonzero(problem.part[block] == part)
                columns = own_columns(problem, free, part)
                at = np.ix_(columns, columns)
                for kind, times in enumerate((point_factors[part], turn_factors[part])):
                    slope = slopes[kind]
                    if slope is None:
                        continue
                    weight = times * (problem.trust[block] * weights[kind])[own]
                    flat = slope[own].reshape(-1, len(columns))
                    found[kind][at] += flat.T @ (np.repeat(weight, 3)[:, None] * flat)
        return found[POSITION], found[TURN]

    def moved(self) -> Array:
        """How all points move with the joints' readings (N, 3, n)."""
        blocks = (
            np.arange(begin, min(begin + BLOCK, len(self.problem)))
            for begin in range(0, len(self.problem), BLOCK)
        )
        parts = [
            moved_by_joints(self.problem, self.table, self.full, self.places, block)[POSITION]
            for block in blocks
        ]
        return np.concatenate(parts)

    def gradients(self) -> Array:
        """The covariance (n, D, D) that a variance of 1 rad^2 of each joint gives the gradient."""
        size = len(self.table.free_columns) + self.problem.places
        covariance = np.zeros((self.problem.arm.n, size, size))
        for each in self.by_part():
            columns, of_joint = each.columns, np.swapaxes(each.gradient, 0, 1)
            covariance[:, columns[:, None], columns] += np.swapaxes(of_joint, 1, 2) @ of_joint
        return covariance


def _expected(slopes: _Slopes, sums: PointSums, inverse: Array) -> Array:
    """What a variance of 1 of a position of weight 1, of each joint, and of a rotation make of the
    squared residuals of positions and of rotations (2, N, 3, 1 + n + 1), where a fit takes up what
    it can."""
    problem, n = slopes.problem, slopes.problem.arm.n
    scattered = [
        sums.normal[POSITION],
        *slopes.gradients(),
        problem.turn_weight**2 * sums.normal[TURN],
    ]
    taken = [inverse @ each @ inverse for each in scattered]
    expected = np.zeros((2, len(problem), 3, n + 2))
    for one in slopes.by_part():
        at = np.ix_(one.columns, one.columns)
        alike = (1 / problem.weight[one.rows, None], np.ones((1, 1)))
        worth = (1.0, problem.turn_weight)
        for kind, column in ((POSITION, 0), (TURN, -1)):
            slope, moved = one.slopes[kind], one.moved[kind]
            if slope is None:
                continue
            reached = slope @ inverse[at]
            found = np.zeros((*slope.shape[:2], n + 2))
            found[:, :, column] = alike[kind] - 2 * worth[kind] * (reached * slope).sum(axis=2)
            back = np.einsum('nkd,njd->nkj', reached, one.gradient, optimize=True)
            found[:, :, 1:-1] = moved**2 - 2 * moved * back
            for number, each in enumerate(taken):
                found[:, :, number] += (slope @ each[at] * slope).sum(axis=2)
            expected[kind, one.rows] = found
    return np.maximum(expected, 0.0)


def _worth(problem: PointProblem, moved: Array, variances: Array, expected: Array) -> int:
    """How many residuals that scatter alike tell their size as well as these tell how far points
    scatter on the whole: the joints make some scatter more than others, and the coordinates of a
    point together."""
    used = np.flatnonzero(variances)
    alike = np.broadcast_to(np.repeat(1 / problem.weight, 3)[:, None], (3 * len(problem), 1))
    own = np.concatenate([alike, moved.reshape(-1, moved.shape[2]) ** 2], axis=1)
    whole = own.mean(axis=0)
    told = expected @ variances
    weighed = expected[:, used] / np.maximum(told, 1e-300)[:, None]
    scale = 1 / np.linalg.norm(weighed, axis=0)
    covariance = 2 * full_inverse(scale[:, None] * (weighed.T @ weighed) * scale)[0]
    along = scale * whole[used]
    scatter = np.einsum('nkj,j,nlj->nkl', moved, variances[1:], moved)
    scatter += variances[0] / problem.weight[:, None, None] * np.eye(3)
    together = (scatter**2).sum() / (np.diagonal(scatter, axis1=1, axis2=2) ** 2).sum()
    uncertain = float(along @ covariance @ along) * float(together)
    return max(int(2 * float(whole @ variances) ** 2 / max(uncertain, 1e-300)), 1)


def gradient_covariance(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    sums: PointSums,
    noise: PointNoise,
) -> Array:
    """The covariance (D, D) that this noise gives the gradient of eq. 10 by all columns of the
    `sums`."""
    slopes = _Slopes(problem, table, full, places)
    position, turn = sums.normal[POSITION], sums.normal[TURN]
    if (noise.point_factors != 1).any() or (noise.turn_factors != 1).any():
        position, turn = slopes.normals(noise.point_factors, noise.turn_factors)
    covariance: Array = noise.poses.point * position
    covariance = covariance + problem.turn_weight**2 * noise.turn * turn
    if noise.poses.joints.any():
        by_joints = slopes.gradients()
        covariance = covariance + np.einsum('j,jde->de', noise.poses.joints, by_joints)
    return covariance
