# SPDX-License-Identifier: Apache-2.0
"""Where the error of identified parameters comes from, so that two calibrations can be compared.

At the minimum of an objective with Hessian H = N + kappa Lambda, to first order,

    x - x_true = -H^-1 (sum_p G_p' e_p + B' c) + (H^-1 N - 1) (x_true - x_nominal)

with e_p what each pose is off by, c the gauge's spheres, and N the data's part of H. What two
calibrations of one arm have in common, the certificate and the nominal values, cancels in their
difference as far as both weigh it alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.levenberg_marquardt import Fit
from calib_solver.fitting.pose_noise import full_inverse
from calib_solver.fitting.solver import Solver
from calib_solver.fitting.uncertainty import gradient_slopes, prior_width
from calib_solver.problem import IntArray, Problem, by_joint, point_jacobian

#: poses at a time
BLOCK = 4096
#: rounds of weighting squared residuals by what is expected of them, and the least that is
ROUNDS, LEAST = 4, 1e-3


@dataclass(frozen=True)
class PoseNoise:
    """The variance of a pose by what makes it scatter: `point` (m^2) of each coordinate, and
    `joints` (n,) of each joint's reading, rad^2; `freedom` residuals are left to tell them by."""

    point: float
    joints: Array
    freedom: int

    def covariance(self, by_joints: Array) -> Array:
        """Of points (N, 3, 3), m^2, that move with the joints by (N, 3, n), m/rad."""
        turned = np.einsum('nkj,j,nlj->nkl', by_joints, self.joints, by_joints)
        covariance: Array = self.point * np.eye(3) + turned
        return covariance


@dataclass(frozen=True)
class ErrorShares:
    """The parts of the error of F free parameters.

    `noise` (F, F): covariance by what single poses are off. The gauge's K spheres being off by
    c (3K,), m, makes an error of `certificate` (F, 3K) times c; the true parameters being off
    nominal by b (F,), of size `width` (F,), makes one of `prior` (F, F) times b.
    """

    noise: Array
    certificate: Array
    prior: Array
    width: Array
    poses: PoseNoise


def error_shares(problem: Problem, solver: Solver, fit: Fit, misfit: float) -> ErrorShares:
    """The shares at a minimum; the poses scatter `misfit` times (of variance) more than is seen
    within a sphere."""
    sums = solver.sums(problem, fit.x)
    slopes = gradient_slopes(problem, solver.options.objective, sums)
    information = solver.information
    inverse, _ = full_inverse(fit.quadratic.normal + np.diag(fit.kappa * information))
    full = solver.full(fit.x)
    found = _pose_noise(problem, solver, full)
    gradient: Array = np.zeros_like(inverse)
    of_pose = np.repeat(np.arange(len(problem.counts)), problem.counts)
    for rows in _blocks(len(of_pose)):
        _, jacobian = point_jacobian(problem, solver.table, full, rows)
        scatter = found.covariance(positions_moved(problem, solver.table, jacobian))
        sphere = of_pose[rows]
        centred = jacobian[:, :, solver.table.free_columns] - sums.jacobian[sphere]
        slope = slopes.weight[sphere, None, None] * centred
        slope += slopes.leverage[sphere] / sums.count[sphere, None, None]
        gradient += np.einsum('nkf,nkl,nlg->fg', slope, scatter, slope, optimize=True)
    return ErrorShares(
        misfit * inverse @ gradient @ inverse,
        -inverse @ slopes.by_center.T,
        inverse @ fit.quadratic.normal - np.eye(len(inverse)),
        prior_width(information, solver.options.prior.strength * solver.wider(fit) ** 2),
        found,
    )


def _pose_noise(problem: Problem, solver: Solver, full: Array) -> PoseNoise:
    """Variances of point and joints that explain the squared residuals about the spheres' means,
    by non-negative least squares, each weighted by what is expected of it."""
    sums = solver.sums(problem, solver.offsets(full))
    count, free = problem.counts, len(solver.table.free_columns)
    freedom = 3 * int(np.maximum(count - 1, 0).sum()) - free
    n = problem.joints.shape[1]
    if freedom < 1:
        return PoseNoise(0.0, np.zeros(n), 0)
    squares, expected = [], []
    of_pose = np.repeat(np.arange(len(count)), count)
    for rows in _blocks(len(of_pose)):
        point, jacobian = point_jacobian(problem, solver.table, full, rows)
        squares.append((point - sums.center[of_pose[rows]]).reshape(-1) ** 2)
        moved = positions_moved(problem, solver.table, jacobian).reshape(-1, n)
        expected.append(np.concatenate([np.ones((len(moved), 1)), moved**2], axis=1))
    known = np.concatenate(squares) * 3 * len(of_pose) / freedom
    variance = variances_of(known, np.concatenate(expected))
    return PoseNoise(float(variance[0]), variance[1:], freedom)


def variances_of(squares: Array, design: Array) -> Array:
    """The variances (K,), none below zero, of which squared residuals (R,) are `design` (R, K)
    times on average; each residual weighted by what is expected of it."""
    from scipy.optimize import nnls  # loads long, and only what is written needs it

    size = max(float(squares.mean()), 1e-300)  # nnls' tolerance is absolute
    squares = squares / size
    scale = np.linalg.norm(design, axis=0)
    scale[scale == 0] = 1.0
    variance, weight = np.zeros(design.shape[1]), np.ones(len(squares))
    for _ in range(ROUNDS):
        variance = nnls(weight[:, None] * design / scale, weight * squares)[0] / scale
        told = design @ variance
        weight = 1 / np.maximum(told, max(LEAST * told.mean(), 1e-300))
        weight /= weight.max()
    return size * variance


def positions_moved(problem: Problem, table: ParameterTable, jacobian: Array) -> Array:
    """How points move with the joints' readings (R, 3, n), m/rad or m/m."""
    arm = problem.measured.arm
    return arm.by_positions(by_joint(table, arm, jacobian))


def _blocks(count: int) -> list[IntArray]:
    """All rows, some at a time."""
    return [np.arange(at, min(at + BLOCK, count)) for at in range(0, count, BLOCK)]
