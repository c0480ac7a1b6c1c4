# SPDX-License-Identifier: Apache-2.0
"""The identification: from a measurement to corrected parameters that account for themselves."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.blas_threads import one_blas_thread
from calib_model.instruments import Arm, Gauge, PassiveProbe, Probe
from calib_model.kinematics import (
    DEFAULT_SIGMA,
    Correction,
    ParameterTable,
    identifiable_table,
)
from calib_model.measurement import Measurement
from calib_solver.error_models import (
    CorrectionChoice,
    JointErrorChoice,
    choose_joint_errors,
    fit_correction,
    table_with,
)
from calib_solver.faults import (
    SMALL,
    Rejected,
    certificate_warnings,
    distance_warnings,
    far_from_nominal,
    mirroring_joints,
    named_joints,
    named_numbers,
    named_scale,
    parameter_warnings,
    pose_warnings,
)
from calib_solver.fitting import (
    DEFAULT_PRIOR,
    LEADING,
    Accumulate,
    ErrorShares,
    Fit,
    Observability,
    Options,
    ParameterEstimate,
    Prior,
    ProbeFit,
    Solver,
    Uncertainty,
    Workspace,
    error_shares,
    estimate_uncertainty,
    estimates_of,
    objective,
    observe,
    over_workspace,
    problem_at,
)
from calib_solver.left_out import LeftOut, judge_left_out, left_out_warnings
from calib_solver.preparation import Prepared, checked_options, prepare
from calib_solver.problem import Folds, Problem, SphereSums, accumulate
from calib_solver.quality import Quality, assess

#: a prior that was given is in the way where without it they lie this part of that apart
LESS = 0.5


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
    left_out: LeftOut | None = None
    choice_12: CorrectionChoice | None = None
    corrected: Quality | None = None

    @cached_property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter in use, in the table's order."""
        return estimates_of(
            self.table, self.full, self.observability, self.uncertainty, self.options.prior
        )

    @property
    def place_shares(self) -> None:
        """Targets and stations are of measured points alone."""
        return None

    @property
    def gauge(self) -> Gauge:
        """What was probed, as long as it was taken to be."""
        return self.problem.measured.gauge

    @cached_property
    def error_shares(self) -> ErrorShares:
        """Where the error of the free parameters comes from."""
        solver = Solver(self.table, self.options, accumulate)
        return error_shares(self.problem, solver, self.fit, self.uncertainty.misfit)

    @cached_property
    def workspace(self) -> Workspace:
        """Postures all over the workspace, and how the probed point goes with the parameters."""
        return over_workspace(self.problem, self.table, self.full)

    @cached_property
    def position_uncertainty(self) -> Array:
        """Standard uncertainty (K,), m, of positions over the workspace, with eq. 12's share."""
        workspace = self.workspace
        sure = workspace.uncertainty(self.uncertainty.covariance)
        beyond = self.choice_12.coefficients if self.choice_12 is not None else None
        if beyond is None:
            return sure
        there = problem_at(self.problem, workspace.joints)
        return np.sqrt(sure**2 + beyond.variance(there, self.table, self.full))

    @cached_property
    def untold(self) -> tuple[str, ...]:
        """What no pose of this kind can tell, whatever the parameters."""
        measured = self.problem.measured
        if not isinstance(measured.probe, PassiveProbe):
            return ()  # its styli are not their own mirror image
        mirroring = mirroring_joints(measured.arm)
        if not mirroring:
            return ()
        return (
            f'whether {named_joints(measured.arm, mirroring)} are counted the other way: the arm '
            'in a mirror fits the gauge as well; a sphere that is known to be on one side of the '
            'arm would tell',
        )

    @property
    def model(self) -> Correction | None:
        """The joint errors identified together with `arm` and `probe`: part of the fit."""
        return Correction.identified(self.arm.joint_names, self.table.joint_errors(self.full))

    @property
    def correction(self) -> Correction | None:
        """All that is corrected beyond the D-H parameters: `model`, and eq. 12 if accepted."""
        chosen = self.choice_12.correction if self.choice_12 is not None else None
        return chosen if chosen is not None else self.model


@dataclass(frozen=True)
class _Solved:
    """The fit and the sums there, by which solver, and what was chosen for it by which folds."""

    solver: Solver
    folds: Folds
    fit: Fit
    sums: SphereSums
    least_noise: float
    joint_errors: JointErrorChoice | None


@one_blas_thread
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
    options = checked_options(options or Options())
    table = identifiable_table(measured.arm, measured.probe, options.fix, options.free)
    solver = Solver(table, options, passes)
    prepared = prepare(measured, solver)
    solved = _solved(prepared)
    done = _judged(prepared, solved)
    done = replace(done, warnings=_warnings(measured, table, prepared, solved, done))
    if options.correction != 'off':
        done = _corrected(done)
    return replace(done, seconds=time.perf_counter() - begun)


def _solved(prepared: Prepared) -> _Solved:
    """The minimum, with the widths and the joint errors that were left to be found."""
    problem = prepared.problem
    fit, descent = prepared.solver.solve(problem, prepared.descent)
    solver = prepared.solver.with_widths(descent)
    folds = Folds(problem)
    errors: JointErrorChoice | None = None
    if solver.options.joint_errors:
        errors = choose_joint_errors(folds, solver, fit)
        if errors.accepted:
            arm, joints = problem.measured.arm, problem.joints
            table = table_with(solver.table, arm, joints, errors.accepted, solver.options.links)
            solver, descent = solver.widened(table, descent)
            fit, descent = solver.solve(problem, descent)
            solver = solver.with_widths(descent)
    fit = solver.whole(problem, fit, descent)
    sums = solver.sums(problem, fit.x)
    return _Solved(solver, folds, fit, sums, descent.least_noise, errors)


def _judged(prepared: Prepared, solved: _Solved) -> Identification:
    """The parameters with all that is said of them, but for the warnings of the result itself."""
    problem, solver, fit = prepared.problem, solved.solver, solved.fit
    table, options, measured = solver.table, solver.options, prepared.problem.measured
    full = solver.full(fit.x)
    arm, probe = table.apply(full, measured.arm, measured.probe)
    observability = observe(table, fit, solver.scale)
    uncertainty = estimate_uncertainty(
        problem,
        options.objective,
        solved.sums,
        fit.quadratic,
        fit.kappa,
        solver.information,
        options.prior.strength,
        solver.wider(fit),
    )
    left_out = None if options.quick else judge_left_out(solved.folds, solver, fit, solved.sums)
    if left_out is not None:
        # what was left out was missed by more than was stated: so will be what was never probed
        grown = uncertainty.covariance * left_out.factor**2
        uncertainty = replace(uncertainty, covariance=grown)
    model = Correction.identified(arm.joint_names, table.joint_errors(full))
    return Identification(
        problem=problem,
        options=options,
        table=table,
        full=full,
        arm=arm,
        probe=probe,
        fit=_with_weakest(fit, observability),
        observability=observability,
        uncertainty=uncertainty,
        probe_fit=prepared.mount,
        initial=prepared.initial,
        identified=assess(problem, arm, probe, model),
        rejected=prepared.rejected,
        seconds=0.0,
        warnings=prepared.warnings,
        least_noise=solved.least_noise,
        joint_error_choice=solved.joint_errors,
        left_out=left_out,
    )


def _warnings(
    measured: Measurement,
    table: ParameterTable,
    prepared: Prepared,
    solved: _Solved,
    done: Identification,
) -> tuple[str, ...]:
    """What to doubt first: the poses, what was said before, the distances, the parameters.

    Mix-ups are looked for over the `table` without joint errors, among all that was `measured`.
    """
    of_poses: tuple[str, ...] = ()
    solver = solved.solver
    # eq. 13 does not look at the poses and leaves them scattered: that is no sign of anything
    if not (
        done.options.quick or done.options.objective == 'distance' or prepared.stuck_throughout
    ):
        # a firm prior keeps hypotheses that fit nothing from wandering for long
        plain = Solver(table, Options(prior=Prior(DEFAULT_SIGMA)), accumulate)
        of_poses = pose_warnings(
            measured,
            done.problem,
            plain,
            done.arm,
            done.probe,
            done.identified,
            done.rejected,
            far_from_nominal(done.table, done.full, solver.scale),
        )
    held = done.fit.kappa * solver.information
    # poses that lie apart let distances look like anything but one sphere out of its place
    of_certificate = certificate_warnings(
        done.problem,
        solved.sums,
        held,
        done.uncertainty.misfit,
        done.uncertainty.noise**2,
        apart=bool(of_poses),
    )
    of_distances = distance_warnings(
        done.options.objective,
        done.initial,
        done.identified,
        done.options.prior.widths(done.table),
        done.uncertainty.standard,
    )
    of_result = named_numbers(done.problem, done.initial.spheres.center) or (
        of_certificate
        + named_scale(done.table, done.full, solver.scale)
        + parameter_warnings(done.table, done.full, solver.scale, done.uncertainty.standard)
    )
    if done.identified.spread > SMALL and not prepared.stuck_throughout:
        of_poses = _held_away(prepared, solver, done.identified.spread) or of_poses
    named = bool(of_poses or of_distances or of_certificate or prepared.stuck_throughout)
    of_left_out = left_out_warnings(done.left_out, named)
    return of_poses + prepared.warnings + of_distances + of_result + of_left_out


def _held_away(prepared: Prepared, solver: Solver, spread: float) -> tuple[str, ...]:
    """A line where it is the prior that was given which leaves poses a `spread` (m) apart."""
    given = solver.options.prior
    if given.evidence or given.strength == 0 or solver.options.objective == 'distance':
        return ()
    free = replace(prepared.solver, options=replace(solver.options, prior=DEFAULT_PRIOR))
    _, descent = free.solve(prepared.problem, replace(prepared.descent, times=None))
    arm, probe = free.arm_and_probe(prepared.problem, descent)
    left = assess(prepared.problem, arm, probe).spread
    if left > LESS * spread:
        return ()
    return (
        f'the prior holds the arm away from what the poses say: they lie {spread * 1e3:.4f} mm '
        f'apart (rms), and {left * 1e3:.4f} mm by --prior auto; this result is not to be used',
    )


def _corrected(done: Identification) -> Identification:
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
    return replace(done, choice_12=choice, corrected=better)


def _with_weakest(fit: Fit, observability: Observability) -> Fit:
    """A fit that did not converge names who is in the directions that are told worst."""
    if fit.converged or not observability.weakest:
        return fit
    return replace(fit, reason=f'{fit.reason}; told worst: {"; ".join(observability.weakest)}')
