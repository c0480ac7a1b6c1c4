# SPDX-License-Identifier: Apache-2.0
"""How positions predicted by the identified arm go with the parameters, over its workspace."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, median
from calib_model.instruments import Arm
from calib_model.kinematics import ParameterTable
from calib_model.measurement import ProbingSet
from calib_solver.problem import Problem, point_jacobian

POSTURES = 500


@dataclass(frozen=True)
class Workspace:
    """The probed point at postures `joints` (K, n), rad: `points` (K, 3), m, in the arm's base
    frame, and `jacobian` (K, 3, F) by the free parameters. The base frame is where d1 and
    theta_0_1 are held, so it carries no uncertainty of its own."""

    joints: Array
    points: Array
    jacobian: Array

    def covariance(self, of_parameters: Array) -> Array:
        """Covariance (K, 3, 3), m^2, of the points, from that of the free parameters (F, F)."""
        of_points: Array = self.jacobian @ of_parameters @ np.swapaxes(self.jacobian, 1, 2)
        return of_points

    def uncertainty(self, of_parameters: Array) -> Array:
        """Standard uncertainty (K,), m, of the points: root sum of squares of the coordinates."""
        variance = np.trace(self.covariance(of_parameters), axis1=1, axis2=2)
        return np.sqrt(np.maximum(variance, 0.0))


def problem_at(problem: Problem, joints: Array) -> Problem:
    """Poses at postures (K, n), rad, of a problem's arm and probe, the readings what they mostly
    are."""
    count, measured = len(joints), problem.measured
    sphere = measured.gauge.numbers[0]
    middle = median(measured.poses.displacement)
    poses = ProbingSet.of([1] * count, [sphere] * count, joints, np.tile(middle, (count, 1)))
    return Problem.of(type(measured)(measured.arm, measured.probe, measured.gauge, poses))


def workspace_at(problem: Problem, table: ParameterTable, full: Array, joints: Array) -> Workspace:
    """The workspace at postures (K, n), rad, with all columns `full` (C,) of the table."""
    there = problem_at(problem, joints)
    points, jacobian = point_jacobian(there, table, full, np.arange(len(joints)))
    return Workspace(joints, points, jacobian[:, :, table.free_columns])


def over_workspace(
    problem: Problem, table: ParameterTable, full: Array, seed: int = 0
) -> Workspace:
    """At postures drawn evenly from the joints' ranges."""
    return workspace_at(problem, table, full, drawn_postures(problem.measured.arm, seed))


def drawn_postures(arm: Arm, seed: int = 0) -> Array:
    """Postures (K, n), rad, m of a rail, drawn evenly from the joints' ranges."""
    generator = np.random.default_rng(seed)
    lower, upper = arm.ranges.T
    return generator.uniform(lower, upper, (POSTURES, arm.n))
