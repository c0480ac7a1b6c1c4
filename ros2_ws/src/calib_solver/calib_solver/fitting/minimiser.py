# SPDX-License-Identifier: Apache-2.0
"""One table of parameters and one prior, with whatever objective there is of them: the way down."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError, FitError, RankError
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.evidence import Group, groups, minimise_by_evidence, widths
from calib_solver.fitting.levenberg_marquardt import ROUNDING, Evaluate, Fit, minimise
from calib_solver.fitting.objectives import Quadratic
from calib_solver.fitting.options import Options


class Named(Protocol):
    """What was measured, and what it is called where something is wrong with it."""

    @property
    def source(self) -> str:
        """The bags or the table that it comes from."""
        ...


class Measured(Protocol):
    """Anything to be solved that was measured."""

    @property
    def measured(self) -> Named:
        """Where it comes from."""
        ...


P = TypeVar('P', bound=Measured)
Same = TypeVar('Same', bound='Minimiser[Any]')


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
class Minimiser(Generic[P]):
    """What is minimised over which parameters: a table with its prior, and a `value` for problems
    of some kind. It holds no state: where a solution has come to is a `Descent`."""

    table: ParameterTable
    options: Options

    @property
    def followed(self) -> bool:
        """Whether the widths of the prior are those that another objective found."""
        return False

    @property
    def needed(self) -> str:
        """What the objective takes at least, in words."""
        return 'it needs more measurements'

    def value(self, problem: P, x: Array) -> Quadratic:
        """The objective at offsets x (F,) from the nominal parameters."""
        raise NotImplementedError

    def guide(self, problem: P) -> Evaluate | None:
        """What leads where poses are few, if anything tells more by them than the objective."""
        return None

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

    def solve(self, problem: P, descent: Descent) -> tuple[Fit, Descent]:
        """The minimum for a problem, from where the descent has come to.

        With widths that follow the evidence the descent has them afterwards: `with_widths`.
        """
        if self.options.prior.evidence and len(descent.x) and not self.followed:
            return self._solve_by_evidence(problem, descent)
        fit = minimise(
            lambda x: self.value(problem, x),
            descent.x,
            self.scale,
            self.information,
            descent.least_noise,
        )
        return fit, descent.after(fit)

    def _solve_by_evidence(self, problem: P, descent: Descent) -> tuple[Fit, Descent]:
        names, group = self.kinds
        times = None
        if descent.times is not None:
            times = np.array([descent.times.get(name, 1.0) for name in names])
        settled = minimise_by_evidence(
            lambda x: self.value(problem, x),
            descent.x,
            group,
            times,
            descent.least_noise,
            self.guide(problem),
        )
        for fit in settled.fits:
            descent = descent.after(fit)
        found = dict(zip(names, map(float, settled.times), strict=True))
        return settled.fit, replace(descent, times=found)

    def with_widths(self: Same, descent: Descent) -> Same:
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

    def widened(self: Same, table: ParameterTable, descent: Descent) -> tuple[Same, Descent]:
        """The same with a table of more columns, and the descent as a start for it."""
        wider = replace(self, table=table)
        full = table.nominal.copy()
        full[self.table.free_columns] += descent.x
        return wider, replace(descent, x=wider.offsets(full), history=())

    def whole(self, problem: P, fit: Fit, descent: Descent) -> Fit:
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

    def refuse_too_little(self, problem: P) -> None:
        """Nothing, where the poses can carry the objective at all.

        Raises:
            DataError: the objective has no terms, or the nominal parameters give no points.
            RankError: fewer residuals than parameters, and no prior.
        """
        quadratic = self.value(problem, np.zeros(len(self.nominal)))
        source, free = problem.measured.source, len(self.nominal)
        if quadratic.terms == 0:
            raise DataError(
                f'{source}: objective {self.options.objective} has no terms here: {self.needed}'
            )
        if not np.isfinite(quadratic.phi):
            raise DataError(f'{source}: the nominal parameters give no finite points')
        if self.options.prior.strength == 0 and quadratic.terms < free:
            raise RankError(
                f'{source}: {int(quadratic.terms)} residuals cannot tell '
                f'{free} parameters without a prior'
            )
