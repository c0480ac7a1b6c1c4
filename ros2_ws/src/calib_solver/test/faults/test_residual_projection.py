# SPDX-License-Identifier: Apache-2.0
"""Products of what faults do, by running sums and pose by pose."""

import numpy as np
import pytest
from simulated_calibration import active, kr5, passive, simulate

from calib_model.kinematics import identifiable_table, point_derivatives
from calib_solver.faults.residual_projection import ResidualProjection
from calib_solver.problem import Problem

# a passive probe on an arm that nothing holds leaves no residuals at all
EACH = pytest.mark.parametrize(
    ('probe', 'held'), [(active, False), (active, True), (passive, True)]
)


def projection(probe, held):
    measured = simulate(kr5(), probe(), 41, locations=2, poses=9, noise=1e-4).measured
    problem = Problem.of(measured)
    table = identifiable_table(measured.arm, measured.probe)
    sigma = np.full(len(table.free_columns), 1e-3) if held else None
    rows = np.unique(np.linspace(0, len(problem.joints) - 1, 60).astype(np.int64))
    return ResidualProjection(problem, table, measured.arm, measured.probe, rows, sigma)


@EACH
def test_faults_from_a_moment_on_have_the_products_of_their_columns(probe, held):
    residuals = projection(probe, held)
    p_flange = residuals.probe.flange_T_probe.apply(residuals.p_probe)
    moved = point_derivatives(residuals.arm, residuals.joints, p_flange).joints
    moments = np.sort(residuals.when)[[1, 7, 20, 21, 44, -1]]
    there = (residuals.when[:, None] >= moments).astype(float)
    for joint, found in enumerate(residuals.products_from(moved, moments)):
        columns = moved[:, :, joint, None] * there[:, None, :]
        fits, among, whole = residuals.products(columns)
        size = np.sqrt(whole.max()) * np.linalg.norm(residuals.left)
        assert found[0] == pytest.approx(fits, abs=1e-12 * size)
        assert found[1] == pytest.approx(among, abs=1e-12 * whole.max())
        assert found[2] == pytest.approx(whole, rel=1e-12)


@EACH
def test_shifts_of_some_poses_have_the_products_of_their_columns(probe, held):
    residuals = projection(probe, held)
    there = np.random.default_rng(3).random((5, len(residuals.when))) < 0.4
    for shifted, *found in zip(there, *residuals.products_of_shifts(there), strict=True):
        fits, among, whole = residuals.products(shifted[:, None, None] * np.eye(3))
        size = np.sqrt(whole.max()) * np.linalg.norm(residuals.left)
        assert found[0] == pytest.approx(fits, abs=1e-12 * size)
        assert found[1] == pytest.approx(among, abs=1e-12 * whole.max())
