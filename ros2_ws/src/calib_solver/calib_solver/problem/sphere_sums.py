# SPDX-License-Identifier: Apache-2.0
"""What one pass over the poses leaves per sphere: all that the objectives need.

With p_i a pose's point, J_i its Jacobian by the free parameters and bars for the sphere's mean,
sum (J_i - J)'(J_i - J) and sum (J_i - J)'(p_i - p) hold everything eq. 11 needs of N poses, so
the memory does not grow with N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import ParameterTable, probing_jacobian
from calib_solver.problem import kernel as compiled
from calib_solver.problem.problem import IntArray, Problem

#: points (R, 3) and their Jacobian (R, 3, F) of rows of a problem's poses
Evaluate = Callable[[IntArray], tuple[Array, Array]]
BLOCK = 1024  # poses at a time: their Jacobians stay in cache


@dataclass(frozen=True)
class SphereSums:
    """Sums over the poses of each of S spheres, by F parameters.

    `count` (S,) sum of weights; `center` (S, 3) mean point, m; `jacobian` (S, 3, F) mean Jacobian;
    `spread` (S, 3) sum of squared deviations per coordinate, m^2; `gradient` (S, F) and
    `normal` (S, F, F) the centred J'r and J'J.
    """

    count: Array
    center: Array
    jacobian: Array
    spread: Array
    gradient: Array
    normal: Array


def accumulate(problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
    """The sums at the parameters `full` (all columns of `table`), by its free columns."""
    if compiled.available(len(problem.cosine), table):
        return accumulate_compiled(problem, table, full)
    return accumulate_numpy(problem, table, full)


def accumulate_compiled(problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
    """The sums by the compiled pass, on all cores."""
    raw = compiled.raw_sums(problem, table, full)
    free = len(table.free_columns)
    count = np.maximum(raw.weight, 1e-300)[:, None]
    mean = raw.moment / count
    jacobian = raw.jacobian / count[:, :, None]
    gradient = raw.normal[:, :free, free]
    normal = raw.normal[:, :free, :free]
    # only the upper triangle is summed
    normal = np.triu(normal) + np.swapaxes(np.triu(normal, 1), 1, 2)
    normal -= count[:, :, None] * (np.swapaxes(jacobian, 1, 2) @ jacobian)
    return SphereSums(
        raw.weight,
        raw.reference + mean,
        jacobian,
        raw.spread - count * mean**2,
        gradient - count * np.einsum('sk,skf->sf', mean, jacobian),
        normal,
    )


def accumulate_numpy(problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
    """The same in numpy alone: the twin that the compiled kernel is tested against."""

    def evaluate(rows: IntArray) -> tuple[Array, Array]:
        point, jacobian = point_jacobian(problem, table, full, rows)
        return point, jacobian[:, :, table.free_columns]

    return accumulate_by(problem, len(table.free_columns), evaluate)


def accumulate_by(problem: Problem, free: int, evaluate: Evaluate) -> SphereSums:
    """The sums by any F = `free` columns: `evaluate` gives points (R, 3) and Jacobian (R, 3, F)
    of some rows of the poses."""
    spheres = len(problem.keys)
    sums = SphereSums(
        np.zeros(spheres),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3, free)),
        np.zeros((spheres, 3)),
        np.zeros((spheres, free)),
        np.zeros((spheres, free, free)),
    )
    for sphere in range(spheres):
        _accumulate_sphere(problem, evaluate, sums, sphere)
    return sums


def _accumulate_sphere(problem: Problem, evaluate: Evaluate, sums: SphereSums, s: int) -> None:
    rows = problem.rows(s)
    reference: Array | None = None
    moment = np.zeros(3)
    for first in range(rows.start, rows.stop, BLOCK):
        block = np.arange(first, min(first + BLOCK, rows.stop))
        point, jacobian = evaluate(block)
        if reference is None:
            # deviations from a point nearby: squares of whole coordinates would drown them
            reference = point[0].copy()
        weight = problem.weight[block]
        deviation = point - reference
        weighted = weight[:, None, None] * jacobian
        sums.count[s] += weight.sum()
        moment += weight @ deviation
        sums.spread[s] += weight @ deviation**2
        sums.jacobian[s] += weighted.sum(axis=0)
        sums.gradient[s] += np.einsum('nkf,nk->f', weighted, deviation)
        flat = jacobian.reshape(-1, jacobian.shape[-1])
        sums.normal[s] += weighted.reshape(flat.shape).T @ flat
    count = sums.count[s]
    if reference is None or count <= 0:
        return
    mean = moment / count
    sums.jacobian[s] /= count
    sums.center[s] = reference + mean
    sums.spread[s] -= count * mean**2
    sums.gradient[s] -= count * (mean @ sums.jacobian[s])
    sums.normal[s] -= count * np.einsum('kf,kg->fg', sums.jacobian[s], sums.jacobian[s])


def point_jacobian(
    problem: Problem, table: ParameterTable, full: Array, rows: IntArray
) -> tuple[Array, Array]:
    """Points (R, 3) of the rows and their Jacobian by every column of the table, (R, 3, C).

    C is 5n + 6, and n more for each joint term. Of compliance, how the torques themselves change
    with the parameters is left out: it is to their effect what that is to the arm.
    """
    arm, probe = table.apply(full, problem.measured.arm, problem.measured.probe)
    return posture_jacobian(arm, probe, table, full, problem.joints[rows], problem.centers[rows])


def posture_jacobian(
    arm: Arm, probe: Probe, table: ParameterTable, full: Array, joints: Array, centers: Array
) -> tuple[Array, Array]:
    """The same at postures `joints` (R, n) with `centers` (R, 3), m, in the frame of the probe;
    `arm` and `probe` are those of all columns `full` (C,)."""
    errors = table.joint_errors(full)
    if errors is None:
        return probing_jacobian(arm, probe, joints, centers)
    basis = errors.terms.basis(arm, joints)
    there = joints + arm.coupled(np.einsum('ntj,tj->nj', basis, errors.values))
    point, jacobian = probing_jacobian(arm, probe, there, centers)
    by_term = by_joint(table, arm, jacobian)[:, :, None, :] * basis[:, None, :, :]
    return point, np.concatenate([jacobian, by_term.reshape(*point.shape, -1)], axis=2)


def by_joint(table: ParameterTable, arm: Arm, jacobian: Array) -> Array:
    """How points move with each joint itself (R, 3, n), m/rad or m/m, from their Jacobian by the
    parameters; `arm.by_positions` makes of it how they move with the positions counted."""
    turned, slid = (
        jacobian[:, :, first : first + arm.n]
        for first in (table.column('theta_0_1'), table.column('d1'))
    )
    moved: Array = arm.direction * np.where(arm.prismatic, slid, -turned)
    return moved
