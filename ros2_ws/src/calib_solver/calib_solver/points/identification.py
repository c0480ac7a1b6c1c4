# SPDX-License-Identifier: Apache-2.0
"""The identification by measured points: parameters, targets and stations that account for
themselves."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib_model.arrays import Array
from calib_model.blas_threads import one_blas_thread
from calib_model.errors import DataError
from calib_model.instruments import Arm, PassiveProbe
from calib_model.kinematics import Correction, ParameterTable
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.transforms import RigidTransform, left_jacobian
from calib_solver.error_models import JointErrorChoice, table_with
from calib_solver.fitting import (
    ASSUMED_NOISE,
    Descent,
    ErrorShares,
    Fit,
    Observability,
    Options,
    ParameterEstimate,
    PoseNoise,
    Uncertainty,
    Workspace,
    covariance_of,
    drawn_postures,
    estimates_of,
    full_inverse,
    observe,
    prior_width,
)
from calib_solver.left_out import LeftOut
from calib_solver.points.gross_errors import RejectedPoint, without_gross_points
from calib_solver.points.judging import Groups, choose_point_errors, judge_points
from calib_solver.points.place_shares import PlaceShares
from calib_solver.points.places import Places, best_places, start_places
from calib_solver.points.problem import FLANGE, PointProblem, points_table
from calib_solver.points.quality import (
    HeldOutPoints,
    PointQuality,
    assess_points,
    flange_of,
    known_quality,
    refuse_unknown_targets,
)
from calib_solver.points.solver import (
    POSITION,
    TURN,
    PointSolver,
    PointSums,
    accumulate_points,
)
from calib_solver.preparation import checked_options
from calib_solver.problem import posture_jacobian

#: the weight of rotations is settled when it changes by less than this part
SETTLED = 1e-4
MOST_ROUNDS = 8
#: rad and m, below which residuals say nothing of the weight of rotations
LEAST_NOISE = 1e-11
#: m, below which what was left out is met
LEAST_MISS = 1e-10
OBJECTIVE = 'position'


@dataclass(frozen=True)
class Placed:
    """A target on the flange or a station: `name`, `points` it has, its `transform`, and the
    standard uncertainty of its translation (3,), m, and rotation vector (3,), rad, the latter None
    where its rotation is not known."""

    name: str
    points: int
    transform: RigidTransform
    translation_uncertainty: Array
    rotation_uncertainty: Array | None


@dataclass(frozen=True)
class PointIdentification:
    """A solved calibration by points: as `Identification`, of targets and stations besides.

    `covariance` (F + P, F + P) is that of the free parameters and of all places' small motions,
    `normal` their J'J, without the prior's share;
    `turn_noise`, rad, a rotation's standard deviation, None where there are none. `initial` and
    `identified` are the quality before and after.
    """

    problem: PointProblem
    options: Options
    table: ParameterTable
    full: Array
    arm: Arm
    fit: Fit
    observability: Observability
    uncertainty: Uncertainty
    covariance: Array
    normal: Array
    turn_noise: float | None
    initial: PointQuality
    identified: PointQuality
    rejected: tuple[RejectedPoint, ...]
    seconds: float
    warnings: tuple[str, ...]
    joint_error_choice: JointErrorChoice | None = None
    left_out: LeftOut | None = None

    @property
    def places(self) -> Places:
        """Targets and stations as identified."""
        return self.identified.places

    @cached_property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter of the arm in use, in the table's order."""
        found = estimates_of(
            self.table, self.full, self.observability, self.uncertainty, self.options.prior
        )
        return tuple(one for one in found if not one.parameter.name.startswith('probe_'))

    @property
    def model(self) -> Correction | None:
        """The joint errors identified together with the arm."""
        errors = self.table.joint_errors(self.full)
        return Correction(self.arm.joint_names, errors) if errors is not None else None

    @property
    def correction(self) -> Correction | None:
        """All that is corrected beyond the D-H parameters."""
        return self.model

    @property
    def gauge(self) -> None:
        """Measured points have none."""
        return None

    @cached_property
    def error_shares(self) -> ErrorShares:
        """Where the error of the free parameters comes from, targets and stations at their best."""
        solver, fit = PointSolver(self.table, self.options), self.fit
        normal, noise = fit.quadratic.normal, self.uncertainty.noise**2
        inverse, rank = full_inverse(normal + np.diag(fit.kappa * solver.information))
        strength = solver.options.prior.strength * solver.wider(fit) ** 2
        freedom = max(int(fit.quadratic.terms) - rank, 0)
        return ErrorShares(
            noise * inverse @ normal @ inverse,
            np.zeros((len(fit.x), 0)),
            inverse @ normal - np.eye(len(fit.x)),
            prior_width(solver.information, strength),
            PoseNoise(noise, np.zeros(self.arm.n), freedom),
        )

    @cached_property
    def place_shares(self) -> PlaceShares:
        """Where the errors of targets and stations come from."""
        weighed = self.fit.kappa * self.options.prior.information(self.table)
        noise, problem = self.uncertainty.noise**2, self.problem
        return PlaceShares.of(self.normal, weighed, noise, problem.targets, problem.stations)

    @property
    def probe(self) -> PassiveProbe:
        """The first target as a seat, for what takes a tool."""
        target = self.targets[0]
        return PassiveProbe(f'target {target.name}', target.transform)

    @cached_property
    def targets(self) -> tuple[Placed, ...]:
        """flange_T_target of every target."""
        problem = self.problem
        _, transforms = self.places.transforms()
        oriented = np.bincount(problem.target, problem.oriented, len(problem.targets)) > 0
        counts = np.bincount(problem.target, minlength=len(problem.targets))
        found = []
        for k, name in enumerate(problem.targets):
            own = self._of_place(k)
            turn = None
            if oriented[k]:
                by_vector = np.linalg.inv(left_jacobian(transforms[k].rotation_vector))
                turn = _standard(by_vector @ own[3:, 3:] @ by_vector.T)
            at = transforms[k] if oriented[k] else RigidTransform(transforms[k].translation)
            found.append(Placed(name, int(counts[k]), at, _standard(own[:3, :3]), turn))
        return tuple(found)

    @cached_property
    def stations(self) -> tuple[Placed, ...]:
        """T_tracker_base of every station."""
        problem = self.problem
        transforms, _ = self.places.transforms()
        counts = np.bincount(problem.station, minlength=len(problem.stations))
        found = []
        for s, number in enumerate(problem.stations):
            own = self._of_place(len(problem.targets) + s)
            turned = transforms[s].rotation
            # the base was moved and turned in itself: R exp(w) = exp(R w) R
            by_vector = np.linalg.inv(left_jacobian(transforms[s].rotation_vector)) @ turned
            moved = _standard(turned @ own[:3, :3] @ turned.T)
            turn = _standard(by_vector @ own[3:, 3:] @ by_vector.T)
            found.append(Placed(str(number), int(counts[s]), transforms[s], moved, turn))
        return tuple(found)

    def _of_place(self, number: int) -> Array:
        first = len(self.fit.x) + 6 * number
        return self.covariance[first : first + 6, first : first + 6]

    @cached_property
    def workspace(self) -> Workspace:
        """The first target at postures all over the workspace; `jacobian` (K, 3, F + 3) by the free
        parameters and by its place on the flange."""
        joints = drawn_postures(self.arm)
        centers = np.broadcast_to(self.places.target[0], (len(joints), 3))
        points, slope = posture_jacobian(self.arm, FLANGE, self.table, self.full, joints, centers)
        held = slope[:, :, self.table.mount][:, :, :3]
        by_both = np.concatenate([slope[:, :, self.table.free_columns], held], axis=2)
        return Workspace(joints, points, by_both)

    @cached_property
    def position_uncertainty(self) -> Array:
        """Standard uncertainty (K,), m, of the first target over the workspace, base frame."""
        size = self.workspace.jacobian.shape[2]
        return self.workspace.uncertainty(self.covariance[:size, :size])


def _standard(covariance: Array) -> Array:
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


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
    if options.correction != 'off':
        raise DataError(
            f'--correction {options.correction}: eq. 12 is for probing poses of a gauge; for '
            'measured points --joint-errors says what the D-H parameters cannot'
        )
    return checked_options(options)


def _solved(
    problem: PointProblem, solver: PointSolver, start: Descent
) -> tuple[PointSolver, Fit, Descent, PointProblem, JointErrorChoice | None]:
    """The minimum, with the weight of rotations, the widths and the joint errors that fit."""
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
    whole = sums[0]
    for one in sums[1:]:
        whole = whole + one
    covariance, noise, assumed = _covariance(problem, solver, fit, whole)
    left_out = judge_points(problem, solver, fit, sums, groups) if groups is not None else None
    if left_out is not None:
        covariance = covariance * left_out.factor**2
    free = len(fit.x)
    uncertainty = Uncertainty(covariance[:free, :free], float(np.sqrt(noise)), 1.0, assumed)
    joint_errors = solver.table.joint_errors(full)
    model = Correction(arm.joint_names, joint_errors) if joint_errors is not None else None
    turn = float(np.sqrt(noise / problem.turn_weight)) if problem.has_orientation else None
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
        uncertainty,
        covariance,
        whole.weighed(problem.turn_weight).normal,
        turn,
        assess_points(problem, before, nominal),
        assess_points(problem, flange_of(problem, arm, model), places),
        (),
        0.0,
        _left_out_lines(left_out),
        errors,
        left_out,
    )


def _covariance(
    problem: PointProblem, solver: PointSolver, fit: Fit, whole: PointSums
) -> tuple[Array, float, bool]:
    """Of parameters and places together, a position's variance, m^2, and whether it is assumed."""
    both = whole.weighed(problem.turn_weight)
    assumed = fit.quadratic.terms - len(fit.x) < 1
    noise = ASSUMED_NOISE**2 if assumed else fit.kappa
    none = np.zeros(problem.places)
    information = np.concatenate([solver.information, none])
    prior = fit.kappa * information
    strength = np.concatenate([solver.options.prior.strength * solver.wider(fit) ** 2, none + 1.0])
    scatter = noise * both.normal + np.diag(fit.kappa**2 * information * strength)
    covariance = covariance_of(scatter, both.normal + np.diag(prior), information, strength)
    return covariance, noise, assumed


def _left_out_lines(left_out: LeftOut | None) -> tuple[str, ...]:
    """A line where points left out were missed by more than was stated."""
    if left_out is None or left_out.factor == 1 or left_out.position.rms < LEAST_MISS:
        return ()
    position = left_out.position
    part = 'stations' if left_out.by == 'station' else 'postures'
    return (
        f'{part} left out are missed by {position.rms * 1e3:.4f} mm where '
        f'{position.stated * 1e3:.4f} mm was stated (rms): the arm has errors beyond its '
        'parameters (joints that bend, encoders, backlash), or a target or a station moved; stated '
        f'uncertainties are enlarged {left_out.factor:.2g} times for it',
    )


def held_out_points(measured: PointMeasurement, done: PointIdentification) -> HeldOutPoints:
    """Points that were not identified from, judged before and after: targets and stations as they
    were identified, stations that are new placed by their own points.

    Raises:
        DataError: another arm, or a target that was not identified.
    """
    refuse_other_joints(measured, done.problem.measured)
    targets, stations = done.problem.targets, done.problem.stations
    refuse_unknown_targets(measured, targets)
    problem = PointProblem.of(measured, targets).turns_weighing(done.problem.turn_weight)
    problem.refuse_too_few()
    before = known_quality(
        problem, flange_of(problem, done.problem.arm), done.initial.places, stations
    )
    flange = flange_of(problem, done.arm, done.correction)
    return HeldOutPoints(
        problem, before, known_quality(problem, flange, done.identified.places, stations)
    )


def refuse_other_joints(measured: PointMeasurement, first: PointMeasurement) -> None:
    """Nothing, where both were measured of one arm.

    Raises:
        DataError: they were not.
    """
    if measured.arm.joint_names != first.arm.joint_names:
        raise DataError(f'{measured.source}: other joints than in {first.source}')


def joined_points(parts: Sequence[PointMeasurement]) -> PointMeasurement:
    """Points of several bags as one measurement: a target or station of one name or number is the
    same in all of them.

    Raises:
        DataError: they are of other arms.
    """
    first = parts[0]
    for part in parts[1:]:
        refuse_other_joints(part, first)
        if not np.array_equal(part.arm.geometry, first.arm.geometry):
            raise DataError(f'{part.source}: other nominal parameters than in {first.source}')
    if len(parts) == 1:
        return first
    points = PointSet.joined([part.points for part in parts])
    return PointMeasurement(first.arm, points, ', '.join(part.source for part in parts)).checked()
