# SPDX-License-Identifier: Apache-2.0
"""The identification: from a measurement to corrected parameters that account for themselves."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import Correction, ParameterTable, identifiable_table
from calib_model.measurement import Measurement
from calib_solver.error_models import (
    CorrectionChoice,
    JointErrorChoice,
    checked_choice,
    checked_kinds,
    choose_joint_errors,
    fit_correction,
    table_with,
)
from calib_solver.faults import (
    Rejected,
    beyond_certificate,
    clean,
    distance_warnings,
    named_numbers,
    named_scale,
    named_sphere,
    parameter_warnings,
    pose_warnings,
    refuse_other_units,
    set_apart,
    stuck_stretches,
)
from calib_solver.fitting import (
    LEADING,
    LOSSES,
    Accumulate,
    Fit,
    Observability,
    Options,
    ProbeFit,
    Solver,
    Uncertainty,
    estimate_uncertainty,
    objective,
    observe,
    try_probe_fit,
)
from calib_solver.problem import Problem, accumulate
from calib_solver.quality import Quality, assess


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

    `passes` adds up the sums per sphere; `options.prior` of the result has the widths that the
    evidence gave it where they are left to that.

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
    solver = Solver(table, options, passes)
    solver.refuse_too_little(problem)
    stretches = stuck_stretches(measured)
    stuck_throughout = bool(stretches) and not set_apart(problem, stretches).any()
    refuse_other_units(problem, assess(problem, measured.arm, measured.probe).spheres.center)
    probe_fit, warnings = try_probe_fit(problem)
    # eq. 11 looks at distances and poses alike: it judges the poses and leads the others there
    alone = options.objective == LEADING
    leader = solver if alone else Solver(table, replace(options, objective=LEADING), passes)
    leader.start_from(problem, probe_fit)
    rejected: tuple[Rejected, ...] = ()
    if options.loss == 'rejecting':
        cleaned = clean(problem, leader.arm_and_probe)
        problem, rejected = cleaned.problem, cleaned.rejected
        warnings = cleaned.warnings + warnings
        solver.refuse_too_little(problem)
    else:
        warnings = tuple(one.line(len(measured.poses)) for one in stretches) + warnings
    if not alone:
        solver.follow(leader, problem)
    fit = solver.solve(problem)
    options = solver.options
    errors: JointErrorChoice | None = None
    if options.joint_errors:
        errors = choose_joint_errors(
            problem,
            table,
            fit.x,
            options.objective,
            options.joint_errors,
            options.links,
            options.prior,
            fit.kappa,
            passes,
        )
        if errors.accepted:
            table = table_with(table, problem, errors.accepted, options.links)
            wider = Solver(table, options, passes)
            wider.go_on_from(solver)
            solver, fit = wider, wider.solve(problem)
            options = solver.options
    fit = solver.account(problem, fit)
    solver.refuse_worse(problem, fit)
    full = solver.full(fit.x)
    arm, probe = table.apply(full, measured.arm, measured.probe)
    sums = passes(problem, table, full)
    observability = observe(table, fit, solver.scale)
    uncertainty = estimate_uncertainty(
        problem,
        options.objective,
        sums,
        fit.quadratic,
        fit.kappa,
        solver.information,
        options.prior.strength,
        solver.wider(fit),
    )
    joint_errors = table.joint_errors(full)
    model = Correction(arm.joint_names, joint_errors) if joint_errors is not None else None
    initial = assess(problem, measured.arm, measured.probe)
    identified = assess(problem, arm, probe, model)
    sigma = options.prior.sigmas(table)
    poses_lie_apart = pose_warnings(
        measured, problem, geometry, arm, probe, identified, options, rejected, stuck_throughout
    )
    held = fit.kappa * solver.information
    other_distances = () if poses_lie_apart else beyond_certificate(identified.distance)
    warnings = poses_lie_apart + warnings
    warnings += distance_warnings(
        options.objective, initial, identified, options.prior.widths(table), uncertainty.standard
    )
    warnings += named_numbers(problem, initial.spheres.center) or (
        (named_sphere(problem, sums, held, uncertainty.misfit) or other_distances)
        + named_scale(table, full, sigma)
        + parameter_warnings(table, full, sigma, uncertainty.standard)
    )
    done = Identification(
        problem,
        options,
        table,
        full,
        arm,
        probe,
        _with_weakest(fit, observability),
        observability,
        uncertainty,
        probe_fit,
        initial,
        identified,
        rejected,
        time.perf_counter() - begun,
        warnings,
        solver.least_noise,
        errors,
    )
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


def _with_weakest(fit: Fit, observability: Observability) -> Fit:
    """A fit that did not converge names who is in the directions that are told worst."""
    if fit.converged or not observability.weakest:
        return fit
    return replace(fit, reason=f'{fit.reason}; told worst: {"; ".join(observability.weakest)}')
