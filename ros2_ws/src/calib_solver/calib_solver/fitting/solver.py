# SPDX-License-Identifier: Apache-2.0
"""One table of parameters, one prior and one objective, solved for as many problems as it takes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError, FitError, RankError
from calib_model.instruments import Arm, PassiveProbe, Probe
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.evidence import Group, groups, minimise_by_evidence, widths
from calib_solver.fitting.levenberg_marquardt import ROUNDING, Fit, minimise
from calib_solver.fitting.objectives import Objective, Quadratic, objective
from calib_solver.fitting.options import Options
from calib_solver.fitting.pose_noise import pose_variance
from calib_solver.fitting.probe_mount import ProbeFit, fit_probe
from calib_solver.problem import Problem, SphereSums

#: sums that are kept: at the nominal parameters, and where the last fits began and ended
KEPT = 4
#: one pass over the poses, as `sphere_sums.accumulate` does it here, or others on other machines
Accumulate = Callable[[Problem, ParameterTable, Array], SphereSums]


@dataclass(frozen=True)
class Descent:
    """How far a solution has come: `x` (F,) about nominal, where the next one starts, and the work
    it took; `least_noise` (m^2) is what a residual's mean square is held to be at least, and
    `times` how many times what is usual each kind of parameter is off, where that was found."""

    x: Array
    least_noise: float = 0.0
    iterations: int = 0
    evaluations: int = 0
    history: tuple[float, ...] = ()
    times: Mapping[str, float] | None = None

    def after(self, fit: Fit) -> Descent:
        """With one more fit behind it."""
        return replace(
            self,
            x=fit.x,
            iterations=self.iterations + fit.iterations,
            evaluations=self.evaluations + fit.evaluations,
            history=self.history + fit.history[1:],
        )


@dataclass(frozen=True)
class Solver:
    """What is minimised over which parameters: a table, an objective with its prior, and how the
    poses are passed over. It holds no state: where a solution has come to is a `Descent`."""

    table: ParameterTable
    options: Options
    passes: Accumulate
    follows: bool = False  # the widths of the prior are those that another objective found

    @cached_property
    def objective(self) -> Objective:
        """The objective of the options."""
        return objective(self.options.objective)

    @cached_property
    def nominal(self) -> Array:
        """The nominal values of the free parameters, (F,)."""
        return self.table.nominal[self.table.free_columns]

    @cached_property
    def scale(self) -> Array:
        """By how much each free parameter is usually off, (F,)."""
        return self.options.prior.sigmas(self.table)

    @cached_property
    def information(self) -> Array:
        """What the prior knows of each free parameter, (F,)."""
        return self.options.prior.information(self.table)

    @cached_property
    def kinds(self) -> tuple[tuple[str, ...], Group]:
        """The kinds of free parameters, each with a width of its own, and who is of which."""
        return groups(self.table, self.scale)

    def full(self, x: Array) -> Array:
        """All columns from offsets of the free ones."""
        return self.table.full(self.nominal + x)

    def offsets(self, full: Array) -> Array:
        """Offsets of the free columns from all of them."""
        x: Array = full[self.table.free_columns] - self.nominal
        return x

    def sums(self, problem: Problem, x: Array) -> SphereSums:
        """The sums at offsets x; the latest few are kept, as fits begin where others ended."""
        key = (id(problem), x.tobytes())
        if key not in self._latest:
            if len(self._latest) >= KEPT:
                del self._latest[next(iter(self._latest))]
            self._latest[key] = (problem, self.passes(problem, self.table, self.full(x)))
        return self._latest[key][1]

    @cached_property
    def _latest(self) -> dict[tuple[int, bytes], tuple[Problem, SphereSums]]:
        """Sums by problem and offsets; the problem is kept so that no other takes its id."""
        return {}

    def value(self, problem: Problem, x: Array) -> Quadratic:
        """The objective at offsets x."""
        return self.objective(problem, self.sums(problem, x))

    def start(self, problem: Problem, mount: ProbeFit | None) -> Descent:
        """The nominal parameters, with the mount of eq. 15 where that fits better."""
        nominal: Array = np.zeros(len(self.nominal))
        if mount is None:
            return Descent(nominal)
        full = self.table.nominal.copy()
        at = mount.flange_T_probe
        full[self.table.mount] = [*at.translation, *at.rotation_vector]
        fitted = self.offsets(full)
        better = self.value(problem, fitted).phi < self.value(problem, nominal).phi
        return Descent(fitted if better else nominal)

    def solve(self, problem: Problem, descent: Descent) -> tuple[Fit, Descent]:
        """The minimum for a problem, from where the descent has come to.

        With widths that follow the evidence the descent has them afterwards: `with_widths`.
        """
        if self.options.prior.evidence and len(descent.x) and not self.follows:
            return self._solve_by_evidence(problem, descent)
        fit = minimise(
            lambda x: self.value(problem, x),
            descent.x,
            self.scale,
            self.information,
            descent.least_noise,
        )
        return fit, descent.after(fit)

    def _solve_by_evidence(self, problem: Problem, descent: Descent) -> tuple[Fit, Descent]:
        names, group = self.kinds
        times = None
        if descent.times is not None:
            times = np.array([descent.times.get(name, 1.0) for name in names])
        settled = minimise_by_evidence(
            lambda x: self.value(problem, x), descent.x, group, times, descent.least_noise
        )
        for fit in settled.fits:
            descent = descent.after(fit)
        found = dict(zip(names, map(float, settled.times), strict=True))
        return settled.fit, replace(descent, times=found)

    def with_widths(self, descent: Descent) -> Solver:
        """With the prior as wide as a descent found it."""
        if descent.times is None:
            return self
        prior = replace(self.options.prior, times=dict(descent.times))
        return replace(self, options=replace(self.options, prior=prior))

    def wider(self, fit: Fit) -> Array:
        """How many times (F,), 1 or more, a prior that was given may be too narrow at a minimum."""
        prior = self.options.prior
        if prior.evidence or prior.strength == 0 or len(fit.x) == 0:
            return np.ones(len(fit.x))
        names, group = self.kinds
        noise = max(fit.kappa, ROUNDING**2)
        found = widths(fit.quadratic, fit.x, noise, group, np.ones(len(names)))
        return np.maximum(found.times, 1.0)[group.kind]

    def arm_and_probe(self, problem: Problem, descent: Descent) -> tuple[Arm, Probe]:
        """The arm and probe that a descent has come to."""
        return self.table.apply(self.full(descent.x), problem.measured.arm, problem.measured.probe)

    def behind(self, leader: Solver, problem: Problem, descent: Descent) -> tuple[Solver, Descent]:
        """A start at another objective's minimum; eq. 13 takes the widths and the poses' noise from
        there.

        Distances alone are often fewer than the parameters: fitted to nothing, they would say
        that there is no noise, and the prior would lose all its weight.
        """
        _, led = leader.solve(problem, descent)
        start = replace(led, history=())
        if self.options.objective != 'distance':
            return self, replace(start, times=None)
        following = replace(self.with_widths(led), follows=True)
        if not len(problem.pairs):
            return following, start
        sums = self.sums(problem, start.x)
        each = (1 / np.maximum(sums.count, 1))[problem.pairs].sum(axis=1)
        noise = pose_variance(sums) * float(each.mean())
        return following, replace(start, least_noise=noise)

    def widened(self, table: ParameterTable, descent: Descent) -> tuple[Solver, Descent]:
        """The same with a table of more columns, and the descent as a start for it."""
        wider = replace(self, table=table)
        full = table.nominal.copy()
        full[self.table.free_columns] += descent.x
        return wider, replace(descent, x=wider.offsets(full), history=())

    def whole(self, problem: Problem, fit: Fit, descent: Descent) -> Fit:
        """The last fit with the work of all of them, from the nominal parameters on.

        Raises:
            FitError: it has a higher objective than the nominal parameters.
        """
        nominal = self.value(problem, np.zeros(len(fit.x))).phi
        if not fit.quadratic.phi <= nominal * (1 + 1e-9) + fit.quadratic.terms * ROUNDING**2:
            raise FitError(
                f'{problem.measured.source}: the fit is worse than the nominal parameters '
                f'(phi {fit.quadratic.phi:.3g} against {nominal:.3g} m^2): {fit.reason}'
            )
        if self.options.prior.evidence and fit.quadratic.terms < len(fit.x):
            few = f'{int(fit.quadratic.terms)} residuals for {len(fit.x)} parameters'
            reason = f'{few}: what the poses do not tell is as the prior has it'
            fit = replace(fit, converged=False, reason=reason)
        return replace(
            fit,
            phi_initial=nominal,
            iterations=descent.iterations,
            evaluations=descent.evaluations,
            history=(nominal, *descent.history),
        )

    def refuse_too_little(self, problem: Problem) -> None:
        """Nothing, where the poses can carry the objective at all.

        Raises:
            DataError: the objective has no terms, or the nominal parameters give no points.
            RankError: fewer residuals than parameters, and no prior.
        """
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


def try_probe_fit(problem: Problem) -> ProbeFit | None:
    """Eq. 15 as a start for P; None where the probe is passive or its readings cannot tell it: the
    fit then starts from the nominal mount, which is no fault of its result."""
    if isinstance(problem.measured.probe, PassiveProbe):
        return None
    try:
        return fit_probe(problem)
    except RankError:
        return None
