# SPDX-License-Identifier: Apache-2.0
"""scipy's least_squares on residuals written out here ends where ours does."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated_calibration import active, iiwa, kr5, passive, random_arm, simulate

from calib_model.kinematics import identifiable_table, points
from calib_solver.fitting.options import Options
from calib_solver.fitting.prior import NO_PRIOR
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)


def residuals_of_eq_11(measured, table):
    """Distance errors, and (x - mean) 2 / sqrt(n - 1) for every pose and coordinate."""
    poses = measured.poses
    centers = measured.centers()
    groups = [
        [
            (sphere, np.flatnonzero((poses.location == location) & (poses.sphere == sphere)))
            for sphere in np.unique(poses.sphere[poses.location == location])
        ]
        for location in np.unique(poses.location)
    ]

    def residuals(free):
        arm, probe = table.apply(table.full(free), measured.arm, measured.probe)
        p_base = points(arm, poses.joints, probe.flange_T_probe.apply(centers))
        parts = []
        for spheres in groups:
            means = []
            for sphere, rows in spheres:
                mean = p_base[rows].mean(axis=0)
                means.append((int(sphere), mean))
                parts.append(((p_base[rows] - mean) * 2 / np.sqrt(len(rows) - 1)).reshape(-1))
            for (j, at_j), (k, at_k) in combinations(means, 2):
                error = np.linalg.norm(at_j - at_k) - measured.gauge.distance(j, k)
                parts.append(np.array([error]))
        return np.concatenate(parts)

    return residuals


def arm_for(number):
    """KR 5s, iiwas and arms of any kind in turn."""
    return (kr5, iiwa, lambda: random_arm(np.random.default_rng(number)))[number % 3]()


@pytest.mark.slow
@pytest.mark.parametrize('number', range(10))
def test_scipy_ends_at_the_same_phi(number):
    probe = active() if number % 2 else passive()
    noise = (2e-5, 1e-4, 5e-4)[number % 3]
    measured = simulate(
        arm_for(number), probe, 100 + number, locations=4, poses=10, noise=noise
    ).measured
    ours = identify(measured, Options(prior=NO_PRIOR))
    table = identifiable_table(measured.arm, measured.probe)
    used = ours.problem.measured  # of the poses that ours rests on
    theirs = least_squares(
        residuals_of_eq_11(used, table),
        table.nominal[table.free_columns],
        jac='3-point',
        method='trf',
        x_scale='jac',
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
        max_nfev=60,
    )
    assert ours.fit.converged
    assert ours.fit.quadratic.phi == pytest.approx(2 * theirs.cost, rel=1e-9)
    assert ours.identified.phi == pytest.approx(2 * theirs.cost, rel=1e-9)
    assert ours.identified.phi < ours.initial.phi
