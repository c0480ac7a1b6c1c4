# SPDX-License-Identifier: Apache-2.0
"""The identification: from a measurement to corrected parameters that account for themselves."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from calib_model.blas_threads import one_blas_thread
from calib_model.kinematics import (
    DEFAULT_SIGMA,
    Correction,
    ParameterTable,
    identifiable_table,
)
from calib_model.measurement import Measurement
from calib_solver.error_models import (
    JointErrorChoice,
    choose_joint_errors,
    fit_correction,
    table_with,
)
from calib_solver.faults import (
    SMALL,
    certificate_warnings,
    distance_warnings,
    far_from_nominal,
    named_numbers,
    named_scale,
    parameter_warnings,
    pose_warnings,
)
from calib_solver.fitting import (
    DEFAULT_PRIOR,
    LEADING,
    Accumulate,
    Fit,
    Observability,
    Options,
    Prior,
    Solver,
    estimate_uncertainty,
    objective,
    observe,
)
from calib_solver.identified import Identification
from calib_solver.left_out import judge_left_out, left_out_warnings
from calib_solver.preparation import Prepared, checked_options, prepare
from calib_solver.problem import Folds, SphereSums, accumulate
from calib_solver.quality import assess

#: a prior that was given is in the way where without it they lie this part of that apart
LESS = 0.5


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
    problem, solver = prepared.problem, prepared.solver
    fit, descent = solver.solve(problem, prepared.descent)
    folds = Folds(problem)
    errors: JointErrorChoice | None = None
    if solver.options.joint_errors:
        settled = solver.with_widths(descent)
        errors = choose_joint_errors(folds, settled, fit)
        if errors.accepted:
            arm, joints = problem.measured.arm, problem.joints
            table = table_with(solver.table, arm, joints, errors.accepted, solver.options.links)
            solver, descent = settled.widened(table, descent)
            fit, descent = solver.solve(problem, descent)
    # by the solver that led there: it has the sums of the nominal parameters and of the minimum
    fit = solver.whole(problem, fit, descent)
    sums = solver.sums(problem, fit.x)
    solver = solver.with_widths(descent)
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
