# SPDX-License-Identifier: Apache-2.0
"""The identification: from a measurement to corrected parameters that account for themselves."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arm import Arm
from calib_model.correction import Correction
from calib_model.errors import DataError, FitError, RankError
from calib_model.freedom import identifiable_table
from calib_model.gravity import Links
from calib_model.parameters import ParameterTable
from calib_model.probe import PassiveProbe, Probe
from calib_model.probing import Measurement
from calib_model.rotation import Array
from calib_solver.correction_fit import CorrectionChoice, checked_choice, fit_correction
from calib_solver.cross_validation import CrossValidation, choose_strength
from calib_solver.joint_error_choice import (
    JointErrorChoice,
    checked_kinds,
    choose_joint_errors,
    table_with,
)
from calib_solver.leanings import named_leanings, named_sphere
from calib_solver.levenberg import ROUNDING, Fit, minimise
from calib_solver.mixups import (
    beyond_belief,
    named_mixups,
    refuse_other_units,
    stuck_styli,
)
from calib_solver.objectives import Objective, Quadratic, objective
from calib_solver.observability import Observability, observe
from calib_solver.prior import DEFAULT_PRIOR, Prior
from calib_solver.probe_fit import ProbeFit, fit_probe
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess
from calib_solver.rejection import Rejected, clean
from calib_solver.sums import SphereSums, accumulate
from calib_solver.uncertainty import Uncertainty, estimate_uncertainty, pose_variance

LOSSES = ('rejecting', 'plain')
LEADING = 'distance_repeatability'

#: one pass over the poses, as `sums.accumulate` does it here, or others on other machines
Accumulate = Callable[[Problem, ParameterTable, Array], SphereSums]


@dataclass(frozen=True)
class Options:
    """What a user can choose: the objective, parameters to fix or free by pattern, the prior, and
    the loss: `rejecting` leaves gross errors out, `plain` keeps every pose.

    `correction` of eq. 12 is `off`, `auto` (only if locations left out get better by it) or
    `harmonic` (all the same). `joint_errors` are kinds offered to be identified, of which
    compliance needs the weights of the `links`.
    """

    objective: str = 'distance_repeatability'
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    prior: Prior = DEFAULT_PRIOR
    loss: str = 'rejecting'
    correction: str = 'off'
    joint_errors: tuple[str, ...] = ()
    links: Links | None = None


@dataclass(frozen=True)
class Identification:
    """A solved calibration: parameters before and after, their fit, and the quality of both.

    `problem` holds the poses that were used; `full` are all columns of `table`; `least_noise`
    (m^2) is what a residual's mean square was held to be at least. `arm` and `probe` are the D-H
    model alone; `model` is what else was identified with it, `choice_12` what came of eq. 12, and
    `corrected` the quality with that where it was accepted.
    """

    problem: Problem
    options: Options
    table: ParameterTable
    full: Array
    arm: Arm
    probe: Probe
    fit: Fit
    observability: Observability
    uncertainty: Uncertainty
    probe_fit: ProbeFit | None
    initial: Quality
    identified: Quality
    rejected: tuple[Rejected, ...]
    seconds: float
    warnings: tuple[str, ...]
    cross_validation: CrossValidation | None = None
    least_noise: float = 0.0
    joint_error_choice: JointErrorChoice | None = None
    choice_12: CorrectionChoice | None = None
    corrected: Quality | None = None

    @property
    def model(self) -> Correction | None:
        """The joint errors identified together with `arm` and `probe`: part of the fit."""
        errors = self.table.joint_errors(self.full)
        return Correction(self.arm.joint_names, errors) if errors is not None else None

    @property
    def correction(self) -> Correction | None:
        """All that is corrected beyond the D-H parameters: `model`, and eq. 12 if accepted."""
        chosen = self.choice_12.correction if self.choice_12 is not None else None
        return chosen if chosen is not None else self.model


def identify(
    measured: Measurement, options: Options | None = None, passes: Accumulate = accumulate
) -> Identification:
    """Eq. 11 (or the chosen objective) minimised from the nominal parameters.

    `passes` adds up the sums per sphere; `options.prior` of the result has the strength that
    cross-validation chose where it was asked to.

    Raises:
        DataError: the poses do not fit the descriptions, or there are not enough of them.
        RankError: nothing can be told from these poses.
        FitError: the fit is worse than its start.
    """
    begun = time.perf_counter()
    options = options or Options()
    checked_choice(options.correction)
    checked_kinds(options.joint_errors, options.links)
    if options.loss not in LOSSES:
        raise DataError(f'no loss {options.loss!r}: expected one of {", ".join(LOSSES)}')
    problem = Problem.of(measured)
    table = identifiable_table(measured.arm, measured.probe, options.fix, options.free)
    geometry = table
    solver = _Solver(table, options, passes)
    solver.refuse_too_little(problem)
    refuse_other_units(problem, assess(problem, measured.arm, measured.probe).spheres.center)
    probe_fit, warnings = _try_probe_fit(problem)
    warnings = stuck_styli(measured) + warnings
    # eq. 11 looks at distances and poses alike: it judges the poses and leads the others there
    alone = options.objective == LEADING
    leader = solver if alone else _Solver(table, replace(options, objective=LEADING), passes)
    leader.start_from(problem, probe_fit)
    rejected: tuple[Rejected, ...] = ()
    if options.loss == 'rejecting':
        cleaned = clean(problem, leader.arm_and_probe)
        problem, rejected = cleaned.problem, cleaned.rejected
        warnings += cleaned.warnings
        solver.refuse_too_little(problem)
    if not alone:
        solver.follow(leader, problem)
    chosen = solver.choose_prior(problem)
    options = solver.options
    fit = solver.solve(problem)
    errors: JointErrorChoice | None = None
    if options.joint_errors:
        errors = choose_joint_errors(
            problem, table, fit.x, options.objective, options.joint_errors, options.links,
            options.prior, fit.kappa, passes,
        )  # fmt: skip
        if errors.accepted:
            table = table_with(table, problem, errors.accepted, options.links)
            wider = _Solver(table, options, passes)
            wider.go_on_from(solver)
            solver, fit = wider, wider.solve(problem)
    fit = solver.account(problem, fit)
    solver.refuse_worse(problem, fit)
    full = solver.full(fit.x)
    arm, probe = table.apply(full, measured.arm, measured.probe)
    sums = passes(problem, table, full)
    observability = observe(table, fit, solver.scale)
    uncertainty = estimate_uncertainty(
        problem, options.objective, sums, fit.quadratic, fit.kappa,
        solver.information, options.prior.strength,
    )  # fmt: skip
    joint_errors = table.joint_errors(full)
    model = Correction(arm.joint_names, joint_errors) if joint_errors is not None else None
    identified = assess(problem, arm, probe, model)
    warnings = _doubts(problem, geometry, arm, probe, identified, options) + warnings
    warnings += named_sphere(problem, identified.spheres.center, uncertainty.misfit)
    done = Identification(
        problem, options, table, full, arm, probe, _with_weakest(fit, observability),
        observability, uncertainty, probe_fit,
        assess(problem, measured.arm, measured.probe), identified,
        rejected, time.perf_counter() - begun, tuple(warnings), chosen,
        solver.least_noise, errors,
    )  # fmt: skip
    return done if options.correction == 'off' else _corrected(done, begun)


def _corrected(done: Identification, begun: float) -> Identification:
    """The same with the correction of eq. 12 tried on what it leaves."""
    forced = done.options.correction == 'harmonic'
    kappa = done.fit.kappa
    if done.options.objective != LEADING:
        # the correction is found on eq. 11's residuals: their mean square counts
        sums = accumulate(done.problem, done.table, done.full)
        quadratic = objective(LEADING)(done.problem, sums)
        kappa = quadratic.phi / max(quadratic.terms, 1.0)
    choice = fit_correction(done.problem, done.table, done.full, kappa, forced)
    found = choice.correction
    better = assess(done.problem, done.arm, done.probe, found) if found is not None else None
    seconds = time.perf_counter() - begun
    return replace(done, choice_12=choice, corrected=better, seconds=seconds)


def _doubts(
    problem: Problem, table: ParameterTable, arm: Arm, probe: Probe, quality: Quality,
    options: Options,
) -> tuple[str, ...]:  # fmt: skip
    """Lines on what the residuals look like: something mixed up, or a fault's shadow.

    Eq. 13 does not look at the poses and leaves them scattered: that is no sign of anything.
    """
    if options.objective == 'distance':
        return ()

    def spread_of(changed: Problem) -> float:
        solver = _Solver(table, replace(options, objective=LEADING), accumulate)
        solver.refuse_too_little(changed)
        solver.start_from(changed, _try_probe_fit(changed)[0])
        return _spread(assess(changed, *solver.arm_and_probe(changed)))

    measured = problem.measured
    spread = _spread(quality)
    return (
        named_mixups(measured, spread, spread_of)
        or named_leanings(problem, table, arm, probe)
        or beyond_belief(spread)
    )


def _spread(quality: Quality) -> float:
    """The usual distance of a pose from its sphere's centre, m: the rms."""
    return float(np.sqrt((quality.deviation**2).sum(axis=1).mean()))


def _with_weakest(fit: Fit, observability: Observability) -> Fit:
    """A fit that did not converge names who is in the directions that are told worst."""
    if fit.converged or not observability.weakest:
        return fit
    return replace(fit, reason=f'{fit.reason}; told worst: {"; ".join(observability.weakest)}')


class _Solver:
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
        fit = minimise(
            lambda x: self.value(problem, x),
            self.start, self.scale, self.information, self.least_noise,
        )  # fmt: skip
        self.start = fit.x
        self.iterations += fit.iterations
        self.evaluations += fit.evaluations
        self.history += fit.history[1:]
        return fit

    def follow(self, leader: _Solver, problem: Problem) -> None:
        """Start from another objective's minimum; eq. 13 takes the poses' noise from there.

        Distances alone are often fewer than the parameters: fitted to nothing, they would say
        that there is no noise, and the prior would lose all its weight.
        """
        self.start = leader.solve(problem).x
        self.iterations, self.evaluations = leader.iterations, leader.evaluations
        if self.options.objective == 'distance' and len(problem.pairs):
            sums = self.sums(problem, self.start)
            each = (1 / np.maximum(sums.count, 1))[problem.pairs].sum(axis=1)
            self.least_noise = pose_variance(sums) * float(each.mean())

    def go_on_from(self, narrower: _Solver) -> None:
        """Start from where a table without the joint errors of this one ended."""
        full = self.table.nominal.copy()
        full[narrower.table.free_columns] += narrower.start
        self.start = full[self.table.free_columns] - self.nominal
        self.iterations, self.evaluations = narrower.iterations, narrower.evaluations
        self.least_noise = narrower.least_noise

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

    def choose_prior(self, problem: Problem) -> CrossValidation | None:
        """Settle the prior's strength where that is left to cross-validation."""
        prior, name = self.options.prior, self.options.objective
        if not prior.candidates:
            return None
        start = self.solve(problem).x
        chosen = choose_strength(problem, self.table, name, prior, start, self.least_noise)
        prior = replace(prior, strength=chosen.chosen, candidates=())
        self.options = replace(self.options, prior=prior)
        self.information = prior.information(self.table)
        return chosen

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


def _try_probe_fit(problem: Problem) -> tuple[ProbeFit | None, tuple[str, ...]]:
    """Eq. 15 as a start for P; an active probe whose readings cannot tell it gets a warning."""
    if isinstance(problem.measured.probe, PassiveProbe):
        return None, ()
    try:
        return fit_probe(problem), ()
    except RankError as error:
        return None, (str(error),)
