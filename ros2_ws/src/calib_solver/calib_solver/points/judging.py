# SPDX-License-Identifier: Apache-2.0
"""Groups of points left out in turn: what the rest says of them, and which joint errors that wants.

All is linear about the fit, so that the sums of each group tell the fits without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_solver.error_models import JointErrorChoice, checked_kinds, chosen_by, table_with
from calib_solver.fitting import AUTO, Fit, Quadratic, covariance_of, linear_step
from calib_solver.left_out import FoldError, LeftOut, growth, prediction
from calib_solver.points.point_sums import PointSums, accumulate_points, eliminated, padded
from calib_solver.points.problem import PointProblem
from calib_solver.points.solver import PointSolver
from calib_solver.problem import IntArray

#: so many stations or more are left out one by one, or several at a time; else regions of postures
FEWEST_STATIONS, MOST_FOLDS = 4, 10
REGIONS, FEWEST_POINTS = 6, 8


@dataclass(frozen=True)
class Groups:
    """A number for each point's group (N,), from 0 on, and by what they are: 'station' or
    'posture'."""

    number: IntArray
    count: int
    by: str

    @property
    def name(self) -> str:
        """What the groups are, in words."""
        return 'stations' if self.by == 'station' else 'postures'

    @classmethod
    def of(cls, problem: PointProblem) -> Groups | None:
        """The groups of a problem, None where there are too few points for any."""
        if len(problem.stations) >= FEWEST_STATIONS:
            count = min(len(problem.stations), MOST_FOLDS)
            return cls(problem.station % count, count, 'station')
        away = problem.joints - problem.joints.mean(axis=0)
        along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
        count = min(REGIONS, len(along) // FEWEST_POINTS)
        if count < 2:
            return None
        region = np.argsort(np.argsort(along, kind='stable'), kind='stable') * count // len(along)
        return cls(region, count, 'posture')


def judge_points(
    problem: PointProblem, solver: PointSolver, fit: Fit, sums: list[PointSums], groups: Groups
) -> LeftOut:
    """Every group as the rest predicts it; `sums` are those of the groups at the fit."""
    information = padded(solver.information, problem.places)
    prior = fit.kappa * information
    about = np.concatenate([fit.x, np.zeros(problem.places)])
    whole = together(sums)
    noise = fit.kappa
    wider = solver.wider(fit)
    strength = solver.options.prior.strength * wider**2
    pull = fit.kappa**2 * information * np.concatenate([strength, np.zeros(problem.places)])
    errors: list[FoldError] = []
    positions: list[FoldError] = []
    for own in sums:
        rest = (whole - own).weighed(problem.turn_weight)
        step = linear_step(rest.normal, rest.gradient, prior, about)
        covariance = covariance_of(
            noise * rest.normal + np.diag(pull),
            rest.normal + np.diag(prior),
            information,
            np.concatenate([strength, np.ones(problem.places)]),
        )
        for turn_weight, found in ((problem.turn_weight, errors), (0.0, positions)):
            part = own.weighed(turn_weight)
            found.append(_fold_error(problem, part, rest, step, covariance, noise))
    return LeftOut(groups.by, groups.count, prediction(positions), None, growth(errors, 0.0))


def _fold_error(
    problem: PointProblem,
    part: Quadratic,
    rest: Quadratic,
    step: Array,
    covariance: Array,
    noise: float,
) -> FoldError:
    """Of a `part` that is left out of the `rest`, stations that only it has placed by it."""
    count = max(round(part.terms / 3), 1)
    kept, new = _stations_known(rest, problem)
    if len(new):
        order = np.concatenate([kept, new])
        reordered = Quadratic(
            part.phi, part.gradient[order], part.normal[np.ix_(order, order)], part.terms
        )
        part = eliminated(reordered, len(kept))[0]
        step, covariance = step[kept], covariance[np.ix_(kept, kept)]
    seen = part.phi + 2 * float(part.gradient @ step) + float(step @ part.normal @ step)
    stated = covariance @ part.normal
    by_parameters = float(np.trace(stated))
    spread = float(np.sum(stated * stated.T)) + 2 * noise * by_parameters
    return FoldError(
        max(seen, 0.0),
        noise * part.terms,
        by_parameters,
        count,
        spread + part.terms * noise**2,
    )


def _stations_known(rest: Quadratic, problem: PointProblem) -> tuple[IntArray, IntArray]:
    """Columns that the rest tells of, and those of stations that it has no points of."""
    columns = np.arange(len(rest.gradient))
    stations = columns >= len(columns) - 6 * len(problem.stations)
    none = (np.diag(rest.normal) == 0) & stations
    return columns[~none], columns[none]


def choose_point_errors(
    problem: PointProblem, solver: PointSolver, fit: Fit, groups: Groups | None
) -> JointErrorChoice:
    """Joint errors that groups left out want, as for probing poses."""
    options = solver.options
    kinds = checked_kinds(options.joint_errors, options.links, problem.arm)
    asked = options.joint_errors != (AUTO,)
    if groups is None or groups.count < FEWEST_STATIONS:
        few = f'{len(problem)} points are too few to judge them by'
        return JointErrorChoice(kinds, (), 0, few, asked)
    table = table_with(solver.table, problem.arm, problem.joints, kinds, options.links)
    wider = replace(solver, table=table)
    full = table.nominal.copy()
    full[solver.table.free_columns] += fit.x
    about = wider.offsets(full)
    places = solver.places(problem, fit.x)
    sums = accumulate_points(problem, table, full, places, groups.number)
    free = len(about)
    prior = fit.kappa * padded(wider.information, problem.places)
    offsets = np.concatenate([about, np.zeros(problem.places)])

    def left_out(columns: IntArray) -> Array:
        used = np.concatenate([columns, np.arange(free, free + problem.places)])
        return squares_left_out(problem, sums, used, prior, offsets)

    choice = chosen_by(table, kinds, left_out, groups.count, asked)
    return replace(choice, left_out=groups.name)


def squares_left_out(
    problem: PointProblem, sums: list[PointSums], used: IntArray, prior: Array, offsets: Array
) -> Array:
    """Mean squares (K,), m^2, of each group of points as a fit to the others predicts it, by the
    columns `used`, of which the last are the places of all stations; stations that only the group
    has are placed by it.

    `prior` (D,), m^2, holds all columns of the `sums` near -`offsets` (D,) from here.
    """
    whole = together(sums)
    nothing = np.zeros((len(offsets), len(offsets)))
    found = []
    for own in sums:
        rest = (whole - own).weighed(problem.turn_weight)
        step = step_by(rest, used, prior, offsets)
        error = _fold_error(problem, own.weighed(problem.turn_weight), rest, step, nothing, 0.0)
        found.append(error.seen / error.count)
    return np.array(found)


def step_by(where: Quadratic, used: IntArray, prior: Array, offsets: Array) -> Array:
    """The step (D,) to the least of an objective by some columns, none in the others."""
    step = np.zeros(len(offsets))
    step[used] = linear_step(
        where.normal[np.ix_(used, used)], where.gradient[used], prior[used], offsets[used]
    )
    return step


def together(sums: list[PointSums]) -> PointSums:
    """The sums over all groups."""
    whole = sums[0]
    for one in sums[1:]:
        whole = whole + one
    return whole
