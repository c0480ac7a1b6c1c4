# SPDX-License-Identifier: Apache-2.0
"""Where the probe sits on the flange: eq. 15 solved, then refined as the rigid mount it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import RankError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import DEFAULT_SIGMA, ParameterTable
from calib_model.transforms import RigidTransform, left_jacobian, rotation_vector
from calib_solver.fitting.levenberg_marquardt import minimise
from calib_solver.fitting.objectives import Quadratic, distance_errors
from calib_solver.fitting.probe_mount_linear import LinearFit, solve_linear
from calib_solver.problem import Problem, SphereSums, accumulate

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
    linear = solve_linear(problem)
    return _refined(problem, linear, use_distances)


def _refined(problem: Problem, linear: LinearFit, use_distances: bool) -> ProbeFit:
    """The rigid P nearest to all readings: the mount's six parameters freed, the arm held."""
    measured = problem.measured
    mount = RigidTransform(linear.mount[:, 3], rotation_vector(linear.rotation))
    started = replace(measured, probe=measured.probe.mounted(mount))
    table = ParameterTable.of(started.arm, started.probe)
    arm_columns = [i for i, name in enumerate(table.names) if not name.startswith('probe_')]
    table = table.frozen_at(arm_columns, 'the arm is held while P is fitted')

    def evaluate(x: Array) -> Quadratic:
        full = table.full(table.nominal[table.free_columns] + x)
        return _scatter(problem, accumulate(problem, table, full), use_distances)

    scale = np.array([DEFAULT_SIGMA[parameter.kind] for parameter in table.free])
    fit = minimise(evaluate, np.zeros(6), scale, np.zeros(6))
    mount = RigidTransform(*np.split(table.full(table.nominal[table.free_columns] + fit.x)[-6:], 2))
    residuals = 3 * len(problem.joints)
    rms = float(np.sqrt(fit.quadratic.phi / residuals))
    uncertainty = _uncertainty(fit.quadratic, mount)
    if uncertainty[3:].max() > LARGEST_ROTATION_UNCERTAINTY:
        spread = problem.centers.std(axis=0).max() * 1e6
        raise RankError(
            f'{measured.source}: eq. 15 lacks rank: the readings vary by only {spread:.3g} um '
            f'against residuals of {rms * 1e6:.3g} um, which leaves the rotation of P undetermined'
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


def _scatter(problem: Problem, sums: SphereSums, use_distances: bool) -> Quadratic:
    """Squared deviations from each sphere's mean, and of the means from the certificate.

    A distance is as good as the two means it is between: weight 1 / (1 / n_j + 1 / n_k) against
    the single poses' 1.
    """
    total = Quadratic(
        float(sums.spread.sum()),
        sums.gradient.sum(axis=0),
        sums.normal.sum(axis=0),
        float(3 * (sums.count - 1).sum()),
    )
    if not use_distances or len(problem.pairs) == 0:
        return total
    error, slope = distance_errors(problem, sums)
    first, second = problem.pairs.T
    weight = 1 / (1 / sums.count[first] + 1 / sums.count[second])
    # a location of k spheres has k(k-1)/2 distances, of which its 2k-3 or so are independent
    weight = weight / _redundancy(problem)
    return total + Quadratic(
        float(weight @ error**2),
        slope.T @ (weight * error),
        slope.T @ (weight[:, None] * slope),
        float(len(error)),
    )


def _redundancy(problem: Problem) -> Array:
    """How often each distance's two spheres take part in distances, on average (M,)."""
    uses = np.bincount(problem.pairs.reshape(-1), minlength=len(problem.keys))
    shared: Array = uses[problem.pairs].mean(axis=1)
    return np.maximum(shared, 1.0)


def _uncertainty(quadratic: Quadratic, mount: RigidTransform) -> Array:
    freedom = max(quadratic.terms - 6, 1)
    covariance = quadratic.phi / freedom * np.linalg.pinv(quadratic.normal, rcond=1e-20)
    turn = np.eye(6)
    turn[3:, 3:] = left_jacobian(mount.rotation_vector)
    uncertainty: Array = np.sqrt(np.maximum(np.diag(turn @ covariance @ turn.T), 0.0))
    return uncertainty
