# SPDX-License-Identifier: Apache-2.0
"""Where the probe sits on the flange: eqs. 14 to 17, linear, then rigid, then refined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.errors import RankError
from calib_model.kinematics import forward
from calib_model.probe import PassiveProbe
from calib_model.rotation import (
    Array,
    RigidTransform,
    nearest_rotation,
    rotation_matrix,
    rotation_vector,
    skew,
)
from calib_solver.problem import Problem

#: singular values of the scaled A below this part of the largest are rounding
RANK_TOLERANCE = 1e-9
#: a rotation of P less sure than this (rad) is no rotation at all
LARGEST_ROTATION_UNCERTAINTY = 0.2
REFINEMENTS = 20


@dataclass(frozen=True)
class ProbeFit:
    """The matrix P of eq. 14 and how well the readings tell it.

    `center` (S, 3) are the probed spheres in the base frame, m; `residual_rms` (m) is over all
    coordinates after refinement; `orthogonality_error` is |P'P - 1| of the linear solution;
    `condition` that of A with columns of unit length; `standard_uncertainty` (6,) of translation
    (m) and of a rotation about the flange's axes (rad).
    """

    flange_T_probe: RigidTransform
    center: Array
    spheres: int
    poses: int
    residual_rms: float
    orthogonality_error: float
    condition: float
    standard_uncertainty: Array


def fit_probe(problem: Problem) -> ProbeFit:
    """P from the poses of one or more spheres, each with its own unknown centre.

    Raises:
        RankError: the readings or the postures vary too little to tell P.
    """
    probe = problem.measured.probe
    if isinstance(probe, PassiveProbe):
        raise RankError(
            f'{problem.measured.source}: eq. 15 lacks rank: {probe.name} is passive, '
            'its readings do not vary'
        )
    T_base_flange = forward(problem.measured.arm, problem.joints)
    sphere = np.repeat(np.arange(len(problem.keys)), problem.counts)
    linear, condition = _solve_linear(problem, T_base_flange, sphere)
    rotation = nearest_rotation(linear[:, :3])
    orthogonality = float(np.linalg.norm(linear[:, :3].T @ linear[:, :3] - np.eye(3)))
    fit = _refine(problem, T_base_flange, sphere, rotation, linear[:, 3])
    if fit.uncertainty[3:].max() > LARGEST_ROTATION_UNCERTAINTY:
        spread = problem.centers.std(axis=0).max() * 1e6
        raise RankError(
            f'{problem.measured.source}: eq. 15 lacks rank: the readings vary by only '
            f'{spread:.3g} um against residuals of {fit.residual_rms * 1e6:.3g} um, '
            'which leaves the rotation of P undetermined'
        )
    return ProbeFit(
        fit.mount, fit.center, len(problem.keys), len(problem.joints), fit.residual_rms,
        orthogonality, condition, fit.uncertainty,
    )  # fmt: skip


def linear_system(
    T_base_flange: Array, centers: Array, sphere: np.ndarray, spheres: int
) -> tuple[Array, Array]:
    """A (3N, 12 + 3S) and b (3N,) of eqs. 16 and 17, for S spheres.

    `T_base_flange` (N, 4, 4), `centers` (N, 3) in the probe frame, `sphere` (N,) from 0. The
    unknowns: p11 p12 p13 p14 p21 ... p34, then each sphere's X_R Y_R Z_R.
    """
    count = len(centers)
    rotation = T_base_flange[:, :3, :3]
    extended = np.concatenate([centers, np.ones((count, 1))], axis=1)
    by_mount = np.einsum('nij,nk->nijk', rotation, extended).reshape(count, 3, 12)
    by_center = np.zeros((count, 3, spheres, 3))
    for axis in range(3):
        by_center[np.arange(count), axis, sphere, axis] = -1.0
    matrix = np.concatenate([by_mount, by_center.reshape(count, 3, -1)], axis=2)
    return matrix.reshape(3 * count, -1), -T_base_flange[:, :3, 3].reshape(-1)


def _solve_linear(
    problem: Problem, T_base_flange: Array, sphere: np.ndarray
) -> tuple[Array, float]:
    """The upper three rows (3, 4) of P as eq. 15 gives them, and the condition of A."""
    matrix, right = linear_system(T_base_flange, problem.centers, sphere, len(problem.keys))
    unknowns = matrix.shape[1]
    if len(matrix) < unknowns:
        raise RankError(
            f'{problem.measured.source}: eq. 15 has {unknowns} unknowns, '
            f'{len(problem.joints)} poses give only {len(matrix)} equations'
        )
    length = np.linalg.norm(matrix, axis=0)
    # a column that is nothing but rounding must not be scaled up to look like data
    length[length < 1e-12 * length.max()] = 1.0
    u, values, vt = np.linalg.svd(matrix / length, full_matrices=False)
    rank = int((values > RANK_TOLERANCE * values[0]).sum())
    if rank < unknowns:
        raise RankError(
            f'{problem.measured.source}: eq. 15 lacks rank ({rank} of {unknowns}): '
            'the readings or the postures do not vary enough to tell P'
        )
    solution = (vt.T @ ((u.T @ right) / values)) / length
    return solution[:12].reshape(3, 4), float(values[0] / values[-1])


@dataclass(frozen=True)
class _Refined:
    mount: RigidTransform
    center: Array
    residual_rms: float
    uncertainty: Array


def _refine(
    problem: Problem, T_base_flange: Array, sphere: np.ndarray, rotation: Array, translation: Array
) -> _Refined:
    """Gauss-Newton on a rigid P; the spheres' centres are the means they have to be."""
    base = T_base_flange[:, :3, :3]
    members = [np.flatnonzero(sphere == s) for s in range(len(problem.keys))]
    for _ in range(REFINEMENTS):
        turned = problem.centers @ rotation.T
        p_base = np.einsum('nij,nj->ni', base, turned + translation) + T_base_flange[:, :3, 3]
        slope = np.concatenate([base, -base @ skew(turned)], axis=2)
        residual, center = _centred(p_base, members)
        slope = _centred(slope, members)[0].reshape(-1, 6)
        step = np.linalg.lstsq(slope, -residual.reshape(-1), rcond=1e-12)[0].astype(np.float64)
        translation = translation + step[:3]
        rotation = rotation_matrix(step[3:]) @ rotation
        if np.abs(step).max() < 1e-14:
            break
    freedom = max(residual.size - 3 * len(members) - 6, 1)
    variance = float((residual**2).sum()) / freedom
    covariance = variance * np.linalg.pinv(slope.T @ slope)
    rms = float(np.sqrt((residual**2).mean()))
    mount = RigidTransform(translation, rotation_vector(rotation))
    return _Refined(mount, center, rms, np.sqrt(np.maximum(np.diag(covariance), 0.0)))


def _centred(values: Array, members: list[np.ndarray]) -> tuple[Array, Array]:
    """Values (N, ...) less their sphere's mean, and the means (S, ...)."""
    means = np.stack([values[0] + (values[own] - values[0]).mean(axis=0) for own in members])
    centred = np.empty_like(values)
    for mean, own in zip(means, members, strict=True):
        centred[own] = values[own] - mean
    return centred, means
