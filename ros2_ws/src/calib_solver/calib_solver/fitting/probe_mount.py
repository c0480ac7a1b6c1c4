# SPDX-License-Identifier: Apache-2.0
"""Where the probe sits on the flange: eq. 15 solved, then refined as the rigid mount it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.blas_threads import one_blas_thread
from calib_model.errors import RankError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import DEFAULT_SIGMA, ParameterTable
from calib_model.transforms import (
    RigidTransform,
    left_jacobian,
    rotation_matrix,
    rotation_vector,
    skew,
)
from calib_solver.fitting.levenberg_marquardt import minimise
from calib_solver.fitting.objectives import Quadratic, distance_errors, errors_between
from calib_solver.fitting.probe_mount_linear import (
    LinearFit,
    MountSums,
    mount_sums,
    solve_linear,
)
from calib_solver.problem import Problem, accumulate

#: a rotation of P less sure than this (rad) is no rotation at all
LARGEST_ROTATION_UNCERTAINTY = 0.2


@dataclass(frozen=True)
class ProbeFit:
    """The matrix P of eq. 14 and how well the readings tell it.

    `residual_rms` (m) is over all coordinates after refinement; `orthogonality_error` is
    |R'R - 1| of the linear solution; `condition` that of A with columns of unit length;
    `standard_uncertainty` (6,) of the translation (m) and of a rotation about the flange's axes
    (rad).
    """

    flange_T_probe: RigidTransform
    spheres: int
    poses: int
    residual_rms: float
    orthogonality_error: float
    condition: float
    standard_uncertainty: Array


@one_blas_thread
def fit_probe(problem: Problem, use_distances: bool = True) -> ProbeFit:
    """P from the poses of one or more spheres, each with its own unknown centre.

    `use_distances` brings in the certificate's distances between spheres of one location, as the
    chapter's section 6.1 suggests at its end.

    Raises:
        RankError: the readings or the postures vary too little to tell P.
    """
    measured = problem.measured
    if isinstance(measured.probe, PassiveProbe):
        raise RankError(
            f'{measured.source}: eq. 15 lacks rank: {measured.probe.name} is passive, '
            'its readings do not vary'
        )
    sums = mount_sums(problem)
    linear = solve_linear(problem, sums)
    return _refined(problem, sums, linear, use_distances)


def _refined(problem: Problem, sums: MountSums, linear: LinearFit, use_distances: bool) -> ProbeFit:
    """The rigid P nearest to all readings: the mount's six parameters freed, the arm held."""
    start = np.concatenate([linear.mount[:, 3], rotation_vector(linear.rotation)])

    def evaluate(x: Array) -> Quadratic:
        return _scatter(problem, sums, start + x, use_distances)

    sigma = DEFAULT_SIGMA['probe_translation'], DEFAULT_SIGMA['probe_rotation']
    fit = minimise(evaluate, np.zeros(6), np.repeat(sigma, 3), np.zeros(6))
    mount = RigidTransform(*np.split(start + fit.x, 2))
    residuals = 3 * len(problem.joints)
    rms = float(np.sqrt(fit.quadratic.phi / residuals))
    uncertainty = _uncertainty(fit.quadratic, mount)
    if uncertainty[3:].max() > LARGEST_ROTATION_UNCERTAINTY:
        spread = problem.centers.std(axis=0).max() * 1e6
        raise RankError(
            f'{problem.measured.source}: eq. 15 lacks rank: the readings vary by only '
            f'{spread:.3g} um against residuals of {rms * 1e6:.3g} um, which leaves the rotation '
            'of P undetermined'
        )
    return ProbeFit(
        mount,
        len(problem.keys),
        len(problem.joints),
        rms,
        linear.orthogonality_error,
        linear.condition,
        uncertainty,
    )


def _numbers(mount: Array) -> tuple[Array, Array]:
    """P's twelve numbers row by row and a -1 behind them (13,), and how they change (13, 6) with
    the translation and rotation vector (6,), m and rad."""
    rotation, turned = rotation_matrix(mount[3:]), skew(left_jacobian(mount[3:]).T)
    rows = np.concatenate([rotation, mount[:3, None]], axis=1)
    slope = np.zeros((3, 4, 6))
    slope[:, 3, :3] = np.eye(3)
    slope[:, :3, 3:] = np.moveaxis(turned @ rotation, 0, 2)
    return np.append(rows, -1.0), np.concatenate([slope.reshape(12, 6), np.zeros((1, 6))])


def _scatter(problem: Problem, sums: MountSums, mount: Array, use_distances: bool) -> Quadratic:
    """Squared deviations from each sphere's mean, and of the means from the certificate.

    A distance is as good as the two means it is between: weight 1 / (1 / n_j + 1 / n_k) against
    the single poses' 1.
    """
    numbers, turn = _numbers(mount)
    residual, slope = sums.triangle @ numbers, sums.triangle @ turn
    total = Quadratic(
        float(residual @ residual),
        slope.T @ residual,
        slope.T @ slope,
        float(3 * (sums.weight - 1).sum()),
    )
    if not use_distances or len(problem.pairs) == 0:
        return total
    error, slope = errors_between(problem, sums.mean @ numbers, sums.mean @ turn)
    weight = _weight(problem, sums.weight)
    return total + Quadratic(
        float(weight @ error**2),
        slope.T @ (weight * error),
        slope.T @ (weight[:, None] * slope),
        float(len(error)),
    )


def with_the_arms_share(problem: Problem, fit: ProbeFit) -> ProbeFit:
    """The fit with the uncertainty that an arm which is not calibrated gives it.

    Residuals that come of the arm's errors do not average out over poses. They are taken for
    errors of all its D-H parameters, in the proportion that is usual, as large as the residuals
    say; what these do to P, to first order, is added.
    """
    measured = problem.measured
    table = ParameterTable.of(measured.arm, measured.probe.mounted(fit.flange_T_probe))
    sums = accumulate(problem, table, table.nominal)
    normal = sums.normal.sum(axis=0)
    if len(problem.pairs):
        _, slope = distance_errors(problem, sums)
        normal = normal + slope.T @ (_weight(problem, sums.count)[:, None] * slope)
    of_arm = table.of_arm
    mount = np.isin(table.free_columns, np.arange(len(table.names))[table.mount])
    sigma = np.array([DEFAULT_SIGMA[one.kind] for one in table.free])[of_arm]
    moved = (
        np.linalg.pinv(normal[np.ix_(mount, mount)], rcond=1e-20) @ normal[np.ix_(mount, of_arm)]
    )
    left = normal[np.ix_(of_arm, of_arm)] - normal[np.ix_(of_arm, mount)] @ moved
    expected = float(sigma**2 @ np.diag(left))
    times = fit.residual_rms**2 * 3 * len(problem.joints) / max(expected, 1e-300)
    by_arm = times * (moved * sigma**2) @ moved.T
    turn = _about_the_flange(fit.flange_T_probe)
    variance = fit.standard_uncertainty**2 + np.diag(turn @ by_arm @ turn.T)
    return replace(fit, standard_uncertainty=np.sqrt(variance))


def _redundancy(problem: Problem) -> Array:
    """How often each distance's two spheres take part in distances, on average (M,)."""
    uses = np.bincount(problem.pairs.reshape(-1), minlength=len(problem.keys))
    shared: Array = uses[problem.pairs].mean(axis=1)
    return np.maximum(shared, 1.0)


def _weight(problem: Problem, count: Array) -> Array:
    """What a distance weighs (M,) beside a single pose, by the poses (S,) of its spheres."""
    first, second = problem.pairs.T
    weight: Array = 1 / (1 / count[first] + 1 / count[second])
    # a location of k spheres has k(k-1)/2 distances, of which its 2k-3 or so are independent
    return weight / _redundancy(problem)


def _about_the_flange(mount: RigidTransform) -> Array:
    """What takes translation and rotation vector to translation and a turn about the flange's axes
    (6, 6)."""
    turn = np.eye(6)
    turn[3:, 3:] = left_jacobian(mount.rotation_vector)
    return turn


def _uncertainty(quadratic: Quadratic, mount: RigidTransform) -> Array:
    freedom = max(quadratic.terms - 6, 1)
    covariance = quadratic.phi / freedom * np.linalg.pinv(quadratic.normal, rcond=1e-20)
    turn = _about_the_flange(mount)
    uncertainty: Array = np.sqrt(np.maximum(np.diag(turn @ covariance @ turn.T), 0.0))
    return uncertainty
