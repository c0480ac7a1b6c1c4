# SPDX-License-Identifier: Apache-2.0
"""What makes measured points scatter: the tracker, every coordinate alike, and the arm's joints,
each point as far as they move it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting import PoseNoise, full_inverse, variances_of
from calib_solver.points.places import Places
from calib_solver.points.point_sums import (
    BLOCK,
    POSITION,
    TURN,
    PointSums,
    own_columns,
    padded,
    point_slopes,
    turning_slopes,
)
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.points.quality import PointQuality
from calib_solver.problem import IntArray, by_joint, posture_jacobian


@dataclass(frozen=True)
class PointNoise:
    """Variances of a position of weight 1 and of the joints, `poses`, and of a rotation about each
    axis, `turn`, rad^2, beyond what the joints do to it."""

    poses: PoseNoise
    turn: float


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
    plain = PointNoise(PoseNoise(variance, np.zeros(n), max(freedom, 0)), turn)
    if freedom < 1:
        return plain
    slopes = _Slopes(problem, table, full, quality.places)
    expected = _expected(slopes, sums, inverse)
    squares = quality.position.reshape(-1) ** 2 - turn * expected[:, -1]
    found = variances_of(np.maximum(squares, 0.0), expected[:, :-1])
    if not found.any():
        return plain
    position, turned = slopes.moved()
    if problem.has_orientation:
        rows = problem.oriented > 0
        turn = max(turn - float((turned[rows] ** 2 @ found[1:]).mean()), 0.0)
    worth = _worth(problem, position, found, expected[:, :-1])
    return PointNoise(PoseNoise(float(found[0]), found[1:], min(worth, freedom)), turn)


@dataclass(frozen=True)
class _Slopes:
    """How the points of a fit go with its columns, and with what makes them scatter."""

    problem: PointProblem
    table: ParameterTable
    full: Array
    places: Places

    def by_part(self) -> Iterator[tuple[IntArray, IntArray, Array, Array, Array]]:
        """Rows (R,) of one part, their columns (d,), the Jacobian of positions (R, 3, d), how these
        move with the joints' readings (R, 3, n), and how the gradient does (R, n, d)."""
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
                columns = own_columns(problem, free, part)
                yield block[own], columns, position[own], moved[own], gradient[own]

    def moved(self) -> tuple[Array, Array]:
        """How all points move and turn with the joints' readings (N, 3, n)."""
        blocks = (
            np.arange(begin, min(begin + BLOCK, len(self.problem)))
            for begin in range(0, len(self.problem), BLOCK)
        )
        parts = [
            moved_by_joints(self.problem, self.table, self.full, self.places, block)
            for block in blocks
        ]
        positions, turns = zip(*parts, strict=True)
        return np.concatenate(positions), np.concatenate(turns)

    def gradients(self) -> Array:
        """The covariance (n, D, D) that a variance of 1 rad^2 of each joint gives the gradient."""
        size = len(self.table.free_columns) + self.problem.places
        covariance = np.zeros((self.problem.arm.n, size, size))
        for _, columns, _, _, gradient in self.by_part():
            of_joint = np.swapaxes(gradient, 0, 1)
            covariance[:, columns[:, None], columns] += np.swapaxes(of_joint, 1, 2) @ of_joint
        return covariance


def _expected(slopes: _Slopes, sums: PointSums, inverse: Array) -> Array:
    """What a variance of 1 of a position of weight 1, of each joint, and of a rotation make of the
    squared residuals of positions (3N, 1 + n + 1), where a fit takes up what it can."""
    problem, n = slopes.problem, slopes.problem.arm.n
    scattered = [
        sums.normal[POSITION],
        *slopes.gradients(),
        problem.turn_weight**2 * sums.normal[TURN],
    ]
    taken = [inverse @ each @ inverse for each in scattered]
    expected = np.zeros((len(problem), 3, n + 2))
    for rows, columns, position, moved, gradient in slopes.by_part():
        at = np.ix_(columns, columns)
        reached = position @ inverse[at]
        expected[rows, :, 0] = 1 / problem.weight[rows, None] - 2 * (reached * position).sum(axis=2)
        back = np.einsum('nkd,njd->nkj', reached, gradient, optimize=True)
        expected[rows, :, 1:-1] = moved**2 - 2 * moved * back
        for number, each in enumerate(taken):
            expected[rows, :, number] += (position @ each[at] * position).sum(axis=2)
    return np.maximum(expected.reshape(-1, n + 2), 0.0)


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
    covariance: Array = noise.poses.point * sums.normal[POSITION]
    covariance = covariance + problem.turn_weight**2 * noise.turn * sums.normal[TURN]
    if noise.poses.joints.any():
        by_joints = _Slopes(problem, table, full, places).gradients()
        covariance = covariance + np.einsum('j,jde->de', noise.poses.joints, by_joints)
    return covariance
