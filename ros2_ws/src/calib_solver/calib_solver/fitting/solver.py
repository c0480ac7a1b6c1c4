# SPDX-License-Identifier: Apache-2.0
"""One table of parameters, one prior and one objective, solved for as many problems as it takes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError, FitError, RankError
from calib_model.instruments import Arm, PassiveProbe, Probe
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.evidence import groups, minimise_by_evidence, widths
from calib_solver.fitting.levenberg_marquardt import ROUNDING, Fit, minimise
from calib_solver.fitting.objectives import Objective, Quadratic, objective
from calib_solver.fitting.options import Options
from calib_solver.fitting.probe_mount import ProbeFit, fit_probe
from calib_solver.fitting.uncertainty import pose_variance
from calib_solver.problem import Problem, SphereSums

#: one pass over the poses, as `sums.accumulate` does it here, or others on other machines
Accumulate = Callable[[Problem, ParameterTable, Array], SphereSums]


class Solver:
    """One table, prior and objective, for as many problems as it takes."""

    def __init__(self, table: ParameterTable, options: Options, passes: Accumulate) -> None:
        self.table = table
        self.passes = passes
        self.options = options
        self.objective: Objective = objective(options.objective)
        self.nominal = table.nominal[table.free_columns]
        self.scale = options.prior.sigmas(table)
        self.information = options.prior.information(table)
        self.start: Array = np.zeros(len(self.nominal))
        self.least_noise = 0.0
        self.kinds, self.group = groups(table, self.scale)
        self.times: Array | None = None
        self.follows = False
        self.history: tuple[float, ...] = ()
        self.iterations = 0
        self.evaluations = 0

    def full(self, x: Array) -> Array:
        """All columns from offsets of the free ones."""
        return self.table.full(self.nominal + x)

    def sums(self, problem: Problem, x: Array) -> SphereSums:
        """The sums at offsets x."""
        return self.passes(problem, self.table, self.full(x))

    def value(self, problem: Problem, x: Array) -> Quadratic:
        """The objective at offsets x."""
        return self.objective(problem, self.sums(problem, x))

    def solve(self, problem: Problem) -> Fit:
        """The minimum, started from where the last one was found."""
        evidence = self.options.prior.evidence and len(self.start) > 0 and not self.follows
        fits = self._by_evidence(problem) if evidence else self._as_given(problem)
        for fit in fits:
            self.iterations += fit.iterations
            self.evaluations += fit.evaluations
            self.history += fit.history[1:]
        self.start = fits[-1].x
        return fits[-1]

    def _as_given(self, problem: Problem) -> tuple[Fit, ...]:
        """With the prior as it was given."""
        return (
            minimise(
                lambda x: self.value(problem, x),
                self.start,
                self.scale,
                self.information,
                self.least_noise,
            ),
        )

    def _by_evidence(self, problem: Problem) -> tuple[Fit, ...]:
        """With widths that follow the evidence, from those of the last time on."""
        settled = minimise_by_evidence(
            lambda x: self.value(problem, x), self.start, self.group, self.times, self.least_noise
        )
        self.times = settled.times
        self._take_widths()
        return settled.fits

    def _take_widths(self) -> None:
        """The prior as wide as the evidence has it."""
        if self.times is None:
            return
        found = dict(zip(self.kinds, map(float, self.times), strict=True))
        self.options = replace(self.options, prior=replace(self.options.prior, times=found))
        self.information = self.options.prior.information(self.table)

    def wider(self, fit: Fit) -> Array:
        """How many times (F,), 1 or more, a prior that was given may be too narrow at a minimum."""
        prior = self.options.prior
        if prior.evidence or prior.strength == 0 or len(fit.x) == 0:
            return np.ones(len(fit.x))
        noise = max(fit.kappa, ROUNDING**2)
        found = widths(fit.quadratic, fit.x, noise, self.group, np.ones(len(self.kinds)))
        return np.maximum(found.times, 1.0)[self.group.kind]

    def follow(self, leader: Solver, problem: Problem) -> None:
        """Start from another objective's minimum; eq. 13 takes the poses' noise from there.

        Distances alone are often fewer than the parameters: fitted to nothing, they would say
        that there is no noise, and the prior would lose all its weight.
        """
        self.start = leader.solve(problem).x
        self.iterations, self.evaluations = leader.iterations, leader.evaluations
        if self.options.objective != 'distance':
            return
        # nor do they tell the widths as the poses do
        self.times, self.follows = leader.times, True
        self._take_widths()
        if len(problem.pairs):
            sums = self.sums(problem, self.start)
            each = (1 / np.maximum(sums.count, 1))[problem.pairs].sum(axis=1)
            self.least_noise = pose_variance(sums) * float(each.mean())

    def go_on_from(self, narrower: Solver) -> None:
        """Start from where a table without the joint errors of this one ended."""
        full = self.table.nominal.copy()
        full[narrower.table.free_columns] += narrower.start
        self.start = full[self.table.free_columns] - self.nominal
        self.iterations, self.evaluations = narrower.iterations, narrower.evaluations
        self.least_noise = narrower.least_noise
        if narrower.times is not None:
            known = dict(zip(narrower.kinds, narrower.times, strict=True))
            self.times = np.array([known.get(kind, 1.0) for kind in self.kinds])
            self.follows = narrower.follows
            self._take_widths()

    def account(self, problem: Problem, fit: Fit) -> Fit:
        """The last fit with the work of all of them, from the nominal parameters on."""
        nominal = self.value(problem, np.zeros(len(fit.x)))
        return replace(
            fit,
            phi_initial=nominal.phi,
            iterations=self.iterations,
            evaluations=self.evaluations,
            history=(nominal.phi, *self.history),
        )

    def arm_and_probe(self, problem: Problem) -> tuple[Arm, Probe]:
        """The best arm and probe for a problem."""
        full = self.full(self.solve(problem).x)
        return self.table.apply(full, problem.measured.arm, problem.measured.probe)

    def start_from(self, problem: Problem, probe_fit: ProbeFit | None) -> None:
        """Start from nominal, or with the mount of eq. 15 where that fits better."""
        if probe_fit is None:
            return
        full = self.table.nominal.copy()
        mount = probe_fit.flange_T_probe
        full[self.table.mount] = [*mount.translation, *mount.rotation_vector]
        fitted = full[self.table.free_columns] - self.nominal
        if self.value(problem, fitted).phi < self.value(problem, self.start).phi:
            self.start = fitted

    def refuse_worse(self, problem: Problem, fit: Fit) -> None:
        """Raise where the fit has a higher objective than the nominal parameters."""
        rounding = fit.quadratic.terms * ROUNDING**2
        if not fit.quadratic.phi <= fit.phi_initial * (1 + 1e-9) + rounding:
            raise FitError(
                f'{problem.measured.source}: the fit is worse than the nominal parameters '
                f'(phi {fit.quadratic.phi:.3g} against {fit.phi_initial:.3g} m^2): {fit.reason}'
            )

    def refuse_too_little(self, problem: Problem) -> None:
        """Raise where the poses cannot carry the objective at all."""
        quadratic = self.value(problem, np.zeros(len(self.nominal)))
        source, free = problem.measured.source, len(self.nominal)
        if quadratic.terms == 0:
            raise DataError(
                f'{source}: objective {self.options.objective} has no terms here: '
                'it needs two spheres in one location or several poses of one sphere'
            )
        if not np.isfinite(quadratic.phi):
            raise DataError(f'{source}: the nominal parameters give no finite points')
        if self.options.prior.strength == 0 and quadratic.terms < free:
            raise RankError(
                f'{source}: {int(quadratic.terms)} residuals cannot tell '
                f'{free} parameters without a prior'
            )


def try_probe_fit(problem: Problem) -> tuple[ProbeFit | None, tuple[str, ...]]:
    """Eq. 15 as a start for P; an active probe whose readings cannot tell it gets a warning."""
    if isinstance(problem.measured.probe, PassiveProbe):
        return None, ()
    try:
        return fit_probe(problem), ()
    except RankError as error:
        return None, (str(error),)
