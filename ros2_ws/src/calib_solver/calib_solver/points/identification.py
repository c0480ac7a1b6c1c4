# SPDX-License-Identifier: Apache-2.0
"""Eq. 10 minimised over measured points, the weight of rotations and the joint errors found with
it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from calib_model.blas_threads import one_blas_thread
from calib_model.errors import DataError
from calib_model.kinematics import Correction
from calib_model.measured_points import PointMeasurement
from calib_solver.error_models import JointErrorChoice, table_with
from calib_solver.fitting import (
    Descent,
    Fit,
    Options,
    observe,
)
from calib_solver.left_out import LeftOut, missed
from calib_solver.points.correction import fit_point_correction
from calib_solver.points.gross_errors import without_gross_points
from calib_solver.points.identified import PointIdentification
from calib_solver.points.judging import Groups, choose_point_errors, judge_points, together
from calib_solver.points.places import Places, best_places, start_places
from calib_solver.points.point_sums import POSITION, TURN, PointSums, accumulate_points
from calib_solver.points.problem import FLANGE, PointProblem, points_table
from calib_solver.points.quality import (
    assess_points,
    flange_of,
)
from calib_solver.points.solver import PointSolver
from calib_solver.preparation import checked_options

#: the weight of rotations is settled when it changes by less than this part
SETTLED = 1e-4
MOST_ROUNDS = 8
#: rad and m, below which residuals say nothing of the weight of rotations
LEAST_NOISE = 1e-11
#: m, below which what was left out is met
LEAST_MISS = 1e-10
OBJECTIVE = 'position'


@one_blas_thread
def identify_points(
    measured: PointMeasurement, options: Options | None = None
) -> PointIdentification:
    """Eq. 10 minimised from the nominal parameters, targets and stations anywhere.

    Raises:
        DataError: the points do not fit the arm, there are not enough of them, or the options are
            for probing poses.
        RankError: fewer residuals than parameters, and no prior.
        FitError: the fit is worse than its start.
    """
    begun = time.perf_counter()
    options = checked_point_options(options or Options(objective=OBJECTIVE))
    table = points_table(measured.arm, options.fix, options.free)
    problem = PointProblem.of(measured)
    problem.refuse_too_few()
    solver = PointSolver(table, options)
    nominal = start_places(problem, table, table.nominal)
    solver.begin_at(nominal)
    solver.refuse_too_little(problem)
    clean = without_gross_points(problem, solver)
    solver, fit, descent, problem, errors = _solved(clean.problem, solver, clean.descent)
    fit = solver.whole(problem, fit, descent)
    done = _judged(problem, solver, fit, nominal, errors)
    if options.correction != 'off':
        done = _corrected(done)
    return replace(
        done,
        rejected=clean.rejected,
        warnings=(*clean.warnings, *done.warnings),
        seconds=time.perf_counter() - begun,
    )


def checked_point_options(options: Options) -> Options:
    """The options as points take them.

    Raises:
        DataError: they ask for what only probing poses of a gauge have.
    """
    if options.objective != OBJECTIVE:
        raise DataError(
            f'--objective {options.objective}: measured points have no distances and no spheres; '
            f'{OBJECTIVE} (eq. 10) is what they take'
        )
    return checked_options(options)


def _solved(
    problem: PointProblem, solver: PointSolver, start: Descent
) -> tuple[PointSolver, Fit, Descent, PointProblem, JointErrorChoice | None]:
    """The minimum, with the weight of rotations, the widths and the joint errors that fit."""
    begun = problem.turn_weight
    fit, descent = solver.solve(problem, replace(start, times=None))
    solver, fit, descent, problem = _weighed(problem, solver, fit, descent)
    if not solver.options.joint_errors:
        return solver, fit, descent, problem, None
    errors = choose_point_errors(problem, solver, fit, Groups.of(problem))
    if errors.accepted:
        places = solver.places(problem, fit.x)
        table = table_with(
            solver.table, problem.arm, problem.joints, errors.accepted, solver.options.links
        )
        solver, descent = solver.widened(table, descent)
        solver.begin_at(places)
        # what a rail's scale left in positions was no reason to trust rotations more
        problem = problem.turns_weighing(begun)
        fit, descent = solver.solve(problem, descent)
        solver, fit, descent, problem = _weighed(problem, solver, fit, descent)
    return solver, fit, descent, problem, errors


def _weighed(
    problem: PointProblem, solver: PointSolver, fit: Fit, descent: Descent
) -> tuple[PointSolver, Fit, Descent, PointProblem]:
    """Rotations weighed by what they and the positions leave, each by its own degrees of freedom
    (variance components), until the weight settles."""
    if not problem.has_orientation:
        return _keeping_places(solver, solver.with_widths(descent)), fit, descent, problem
    for _ in range(MOST_ROUNDS):
        found = _turn_weight(problem, solver, fit)
        change = abs(np.log(found / problem.turn_weight))
        if change < SETTLED:
            break
        problem = problem.turns_weighing(found)
        fit, descent = solver.solve(problem, descent)
    return _keeping_places(solver, solver.with_widths(descent)), fit, descent, problem


def _keeping_places(solver: PointSolver, other: PointSolver) -> PointSolver:
    if other is not solver and solver._places:
        other.begin_at(solver._places[0])
    return other


def _turn_weight(problem: PointProblem, solver: PointSolver, fit: Fit) -> float:
    """The variance of a position's coordinate by that of a rotation, m^2/rad^2."""
    sums = _sums_at(problem, solver, fit)[0]
    whole = sums.weighed(problem.turn_weight)
    prior = fit.kappa * np.concatenate([solver.information, np.zeros(problem.places)])
    inverse = np.linalg.pinv(whole.normal + np.diag(prior), rcond=1e-14, hermitian=True)
    taken = np.einsum('ij,wji->w', inverse, sums.normal) * (1.0, problem.turn_weight)
    freedom = np.maximum(sums.count - taken, 1.0)
    variance = np.maximum(sums.phi / freedom, LEAST_NOISE**2)
    return float(variance[POSITION] / variance[TURN])


def _sums_at(
    problem: PointProblem, solver: PointSolver, fit: Fit, groups: Groups | None = None
) -> list[PointSums]:
    places = solver.places(problem, fit.x)
    folds = groups.number if groups is not None else None
    return accumulate_points(problem, solver.table, solver.full(fit.x), places, folds)


def _judged(
    problem: PointProblem,
    solver: PointSolver,
    fit: Fit,
    nominal: Places,
    errors: JointErrorChoice | None,
) -> PointIdentification:
    """The parameters with all that is said of them."""
    full, measured = solver.full(fit.x), problem.measured
    arm, _ = solver.table.apply(full, measured.arm, FLANGE)
    groups = None if solver.options.quick or len(fit.x) == 0 else Groups.of(problem)
    sums = _sums_at(problem, solver, fit, groups)
    whole = together(sums)
    left_out = judge_points(problem, solver, fit, sums, groups) if groups is not None else None
    model = Correction.identified(arm.joint_names, solver.table.joint_errors(full))
    places = solver.places(problem, fit.x)
    before = flange_of(problem, measured.arm)
    nominal = best_places(problem, before, nominal)
    return PointIdentification(
        problem,
        solver.options,
        solver.table,
        full,
        arm,
        fit,
        observe(solver.table, fit, solver.scale),
        whole,
        assess_points(problem, before, nominal),
        assess_points(problem, flange_of(problem, arm, model), places),
        (),
        0.0,
        _left_out_lines(left_out),
        errors,
        left_out,
    )


def _corrected(done: PointIdentification) -> PointIdentification:
    """The same with the correction of eq. 12 tried on what it leaves."""
    forced = done.options.correction == 'harmonic'
    found = fit_point_correction(
        done.problem, done.table, done.full, done.places, done.fit.kappa, forced
    )
    done = replace(done, choice_12=found.choice)
    if not found.choice.accepted:
        return done
    flange = flange_of(done.problem, done.arm, done.correction)
    return replace(done, corrected=assess_points(done.problem, flange, found.places))


def _left_out_lines(left_out: LeftOut | None) -> tuple[str, ...]:
    """A line where points left out were missed by more than was stated."""
    if left_out is None or left_out.factor == 1 or left_out.position.rms < LEAST_MISS:
        return ()
    part = 'stations' if left_out.by == 'station' else 'postures'
    return (
        f'{missed(left_out, part)}: the arm has errors beyond its parameters (joints that bend, '
        'encoders, backlash), or a target or a station moved; stated uncertainties are enlarged '
        f'{left_out.factor:.2g} times for it',
    )
