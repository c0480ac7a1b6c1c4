# SPDX-License-Identifier: Apache-2.0
"""Our solve against scipy's Levenberg-Marquardt, with our Jacobian, without, and on pybotics."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from benchmarks.measuring import Part, Row, Target, best_of, timed
from benchmarks.problems import faro_measurement
from benchmarks.solving import solve
from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable, identifiable_table, points
from calib_solver.fitting import NO_PRIOR
from calib_solver.problem import Problem, point_jacobian

#: scipy's tolerances: tight enough for phi to agree to SAME_PHI
TOLERANCE, SAME_PHI = 1e-12, 1e-9
#: poses per sphere that pybotics gets: it walks them one by one
FEW = 8
#: what pybotics' optimiser may ask for; without a Jacobian it needs one evaluation a parameter
EVALUATIONS = 2_000


class Residuals:
    """Eq. 11 as one vector (3N + M,): what leaves each sphere's mean, then the distance errors."""

    def __init__(self, problem: Problem, table: ParameterTable) -> None:
        self.problem, self.table = problem, table
        self.nominal = table.nominal[table.free_columns]
        self.scale = NO_PRIOR.sigmas(table)
        self.first = problem.start[:-1]
        self.weight = np.repeat(2 / np.sqrt(problem.counts - 1), problem.counts)

    def full(self, x: Array) -> Array:
        """All parameters at x (F,), offsets from nominal in units of the scale."""
        return self.table.full(self.nominal + self.scale * x)

    def __call__(self, x: Array) -> Array:
        """The residuals, m."""
        measured = self.problem.measured
        arm, probe = self.table.apply(self.full(x), measured.arm, measured.probe)
        mounted = probe.flange_T_probe.apply(self.problem.centers)
        return self.of_points(points(arm, self.problem.joints, mounted))

    def of_points(self, p_base: Array) -> Array:
        """The residuals when the probed points are p_base (N, 3)."""
        left, mean = self._centred(p_base)
        distance = np.linalg.norm(self._between(mean), axis=1) - self.problem.nominal
        return np.concatenate([left.reshape(-1), distance])

    def jacobian(self, x: Array) -> Array:
        """Their derivative, shape (3N + M, F)."""
        rows = np.arange(len(self.problem.joints))
        p_base, by_all = point_jacobian(self.problem, self.table, self.full(x), rows)
        by_free = by_all[:, :, self.table.free_columns] * self.scale
        left, mean = self._centred(by_free)
        between = self._between(self._centred(p_base)[1])
        unit = between / np.linalg.norm(between, axis=1)[:, None]
        distance = np.einsum('mk,mkf->mf', unit, self._between(mean))
        return np.concatenate([left.reshape(-1, len(x)), distance])

    def _centred(self, values: Array) -> tuple[Array, Array]:
        """Values (N, 3, ...) less their sphere's mean, weighted, and the means (S, 3, ...)."""
        counts = self.problem.counts
        shape = (-1,) + (1,) * (values.ndim - 1)
        mean = np.add.reduceat(values, self.first, axis=0) / counts.reshape(shape)
        return self.weight.reshape(shape) * (values - np.repeat(mean, counts, axis=0)), mean

    def _between(self, mean: Array) -> Array:
        first, second = self.problem.pairs.T
        difference: Array = mean[first] - mean[second]
        return difference


def by_scipy(residuals: Residuals, with_jacobian: bool) -> OptimizeResult:
    """scipy's `least_squares(method='lm')` (MINPACK) from the nominal parameters."""
    return least_squares(
        residuals,
        np.zeros(len(residuals.nominal)),
        method='lm',
        jac=residuals.jacobian if with_jacobian else '2-point',
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
    )


def against_scipy(poses: int, rounds: int) -> Part:
    """Times and phi, the identifiable parameters free."""
    problem, table = _ready(poses)
    residuals = Residuals(problem, table)
    phi: dict[str, float] = {}

    def scipy(name: str, with_jacobian: bool) -> Callable[[], None]:
        def run() -> None:
            phi[name] = 2 * float(by_scipy(residuals, with_jacobian).cost)

        return run

    def ours() -> None:
        phi['our solve'] = solve(problem, table).quadratic.phi

    names = {'scipy lm, our Jacobian': True, 'scipy lm, differences': False}
    peers = {name: timed(scipy(name, flag)) for name, flag in names.items()}
    best = best_of({'our solve': timed(ours), **peers}, rounds)
    rows = tuple(
        Row(name, s, s / best['our solve'], 'our solve', f'phi {phi[name]:.10e} m^2')
        for name, s in best.items()
    )
    apart = abs(phi['scipy lm, our Jacobian'] / phi['our solve'] - 1)
    return Part(
        f'against scipy, {poses} poses, {len(table.free_columns)} parameters free, no prior',
        rows,
        (Target('phi apart from scipy with our Jacobian, relative', apart, SAME_PHI),),
    )


def against_pybotics(poses: int, rounds: int) -> Part:
    """Forward kinematics by pybotics inside the same scipy optimiser, on few poses."""
    try:
        robots = importlib.import_module('pybotics.robot')
        chains = importlib.import_module('pybotics.kinematic_chain')
    except ImportError:
        nothing = Row('pybotics + scipy', note='not installed: pip install pybotics')
        return Part('against pybotics', (nothing,))
    few = min(poses, FEW * 28)
    problem, table = _ready(few)
    phi: dict[str, float] = {}

    def ours() -> None:
        phi['our solve'] = solve(problem, table).quadratic.phi

    def theirs() -> None:
        residuals = _Pybotics(problem, table, robots.Robot, chains.MDHKinematicChain)
        found = least_squares(
            residuals, np.zeros(len(residuals.nominal)), method='lm', max_nfev=EVALUATIONS
        )
        phi['pybotics + scipy lm'] = 2 * float(found.cost)

    best = best_of({'our solve': timed(ours), 'pybotics + scipy lm': timed(theirs)}, rounds)
    rows = tuple(
        Row(name, s, s / best['our solve'], 'our solve', f'phi {phi[name]:.7e} m^2')
        for name, s in best.items()
    )
    return Part(f'against pybotics, {few} poses, {len(table.free_columns)} parameters free', rows)


class _Pybotics(Residuals):
    """The same residuals on pybotics' robot, which knows modified D-H: link i has a and alpha of
    the joint before; the last joint's go, with the probe, into the tool."""

    def __init__(self, problem: Problem, table: ParameterTable, robot: Any, chain: Any) -> None:
        super().__init__(problem, table)
        self.robot, self.chain = robot, chain

    def __call__(self, x: Array) -> Array:
        measured = self.problem.measured
        arm, probe = self.table.apply(self.full(x), measured.arm, measured.probe)
        a, alpha, d, theta_0, _ = arm.geometry
        before = np.stack([np.roll(alpha, 1), np.roll(a, 1), -theta_0, d], axis=1)
        before[0, :2] = 0.0
        robot = self.robot(self.chain(before))
        center = probe.flange_T_probe.apply(self.problem.centers)
        y, z = center[:, 1], center[:, 2]
        cosine, sine = np.cos(alpha[-1]), np.sin(alpha[-1])
        tip = np.stack([center[:, 0] + a[-1], cosine * y - sine * z, sine * y + cosine * z], axis=1)
        joints = measured.arm.direction * self.problem.joints
        frames = np.array([robot.fk(q) for q in joints])
        return self.of_points(np.einsum('nij,nj->ni', frames[:, :3, :3], tip) + frames[:, :3, 3])


def _ready(poses: int) -> tuple[Problem, ParameterTable]:
    measured = faro_measurement(poses)
    return Problem.of(measured), identifiable_table(measured.arm, measured.probe)
