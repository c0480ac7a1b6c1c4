# SPDX-License-Identifier: Apache-2.0
"""How sure positions predicted by the identified arm are, over its workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.measurement import ProbingSet
from calib_solver.identification import Identification
from calib_solver.problem import Problem, point_jacobian

POSTURES = 500


@dataclass(frozen=True)
class WorkspaceUncertainty:
    """Standard uncertainty of the probed point at `joints` (K, n): `position` (K,), m, the root
    sum of squares over the three coordinates in the arm's base frame; `points` (K, 3) are where
    the identified arm says they are, m."""

    joints: Array
    position: Array
    points: Array


def position_uncertainty(
    done: Identification, joints: Array, covariance: Array | None = None
) -> Array:
    """Covariance (K, 3, 3) of the probed point at postures `joints` (K, n), m^2.

    `covariance` (F, F) of the free parameters is the stated one where none is given. The base
    frame is where d1 and theta_0_1 are held, so it carries no uncertainty of its own.
    """
    return _points_and_covariance(done, joints, covariance)[1]


def _points_and_covariance(
    done: Identification, joints: Array, covariance: Array | None
) -> tuple[Array, Array]:
    """The points (K, 3), m, and their covariance (K, 3, 3)."""
    count = len(joints)
    measured = done.problem.measured
    sphere = measured.gauge.numbers[0]
    middle = np.median(measured.poses.displacement, axis=0)
    poses = ProbingSet.of([1] * count, [sphere] * count, joints, np.tile(middle, (count, 1)))
    problem = Problem.of(type(measured)(measured.arm, measured.probe, measured.gauge, poses))
    p_base, jacobian = point_jacobian(problem, done.table, done.full, np.arange(count))
    jacobian = jacobian[:, :, done.table.free_columns]
    if covariance is None:
        covariance = done.uncertainty.covariance
    of_points: Array = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2)
    return p_base, of_points


def over_workspace(
    done: Identification, covariance: Array | None = None, seed: int = 0
) -> WorkspaceUncertainty:
    """At postures drawn evenly between the joint limits, half a turn either way where none are."""
    limits = np.clip(done.arm.limits, -np.pi, np.pi)
    generator = np.random.default_rng(seed)
    joints = generator.uniform(limits[:, 0], limits[:, 1], (POSTURES, done.arm.n))
    p_base, of_points = _points_and_covariance(done, joints, covariance)
    variance = np.trace(of_points, axis1=1, axis2=2)
    return WorkspaceUncertainty(joints, np.sqrt(np.maximum(variance, 0.0)), p_base)
