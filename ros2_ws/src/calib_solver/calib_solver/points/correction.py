# SPDX-License-Identifier: Apache-2.0
"""Eq. 12 for measured points: functions of the joints, found from what the arm's model leaves.

Targets are held, as the parameters are, so that the tool stays what it was; stations are placed
anew with the functions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.error_models import (
    FEWEST_LOCATIONS,
    CorrectionChoice,
    CorrectionColumns,
    Gain,
    best_basis,
    too_few,
)
from calib_solver.fitting import full_inverse
from calib_solver.points.judging import Groups, squares_left_out, step_by, together
from calib_solver.points.places import Flange, Places, motions
from calib_solver.points.point_sums import Slopes, accumulate_points_by, padded, turning_slopes
from calib_solver.points.problem import FLANGE, PointProblem
from calib_solver.problem import IntArray, posture_jacobian


@dataclass(frozen=True)
class PlacedCorrection:
    """What came of eq. 12, and targets and stations with it."""

    choice: CorrectionChoice
    places: Places


def fit_point_correction(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    kappa: float,
    forced: bool = False,
) -> PlacedCorrection:
    """The correction for the model of a table at `full` (C,), or why there is none.

    `kappa` (m^2) is the mean square of eq. 10's residuals there. Refused where groups of points
    left out do not get better by it beyond doubt, unless `forced`.
    """
    groups = Groups.of(problem)
    if groups is None or groups.count < FEWEST_LOCATIONS:
        return PlacedCorrection(
            too_few(f'{len(problem)} points are too few to judge it by'), places
        )
    columns = CorrectionColumns.all(table.n)
    residuals = Flange.of(problem, table, full).residuals(problem, places)

    def slopes(rows: IntArray) -> Slopes:
        return _slopes(problem, table, full, places, columns, rows)

    sums = accumulate_points_by(problem, columns.count, residuals, slopes, groups.number)
    targets = columns.count + np.arange(6 * len(problem.targets))
    stations = columns.count + np.arange(6 * len(problem.stations))
    sums = [one.only(np.setdiff1d(np.arange(len(one.gradient[0])), targets)) for one in sums]
    offsets = np.zeros(columns.count + len(stations))

    def left_out(taken: IntArray, information: Array) -> Array:
        prior = kappa * padded(information, len(stations))
        return squares_left_out(problem, sums, np.r_[taken, stations], prior, offsets)

    without = left_out(np.zeros(0, dtype=np.int64), np.zeros(columns.count))
    found = best_basis(columns, lambda taken, held: Gain.of(left_out(taken, held), without))
    used = np.r_[found.taken, stations]
    prior = kappa * padded(found.information, len(stations))
    whole = together(sums).weighed(problem.turn_weight)
    step = step_by(whole, used, prior, offsets)
    held = whole.normal[np.ix_(used, used)] + np.diag(prior[used])
    count = len(found.taken)
    sure = kappa * full_inverse(held)[0][:count, :count]
    choice = found.choice(
        problem.arm,
        f'{groups.name} left out change by {found.gain.words}',
        step[: columns.count],
        sure,
        table.joint_errors(full),
        forced,
    )
    choice = replace(choice, folds=groups.count)
    if not choice.accepted:
        return PlacedCorrection(choice, places)
    moved = np.concatenate([np.zeros(len(targets)), step[columns.count :]])
    return PlacedCorrection(choice, places.moved(moved))


def _slopes(
    problem: PointProblem,
    table: ParameterTable,
    full: Array,
    places: Places,
    columns: CorrectionColumns,
    rows: IntArray,
) -> Slopes:
    """Jacobians (R, 3, F + 12) of rows by the columns of eq. 12 and by their places."""
    arm, _ = table.apply(full, problem.arm, FLANGE)
    joints, centers = problem.joints[rows], places.target[problem.target[rows]]
    points, jacobian = posture_jacobian(arm, FLANGE, table, full, joints, centers)
    rotation = jacobian[:, :, table.mount][:, :, :3]
    moved, turned = motions(rotation, points)
    position = np.concatenate([columns.moving(table, arm, joints, jacobian), moved], axis=2)
    if not problem.oriented[rows].any():
        return position, None
    turns = columns.turning(table, arm, joints, turning_slopes(table, arm, full, joints))
    by_angle = np.zeros((len(rows), 3, columns.count))
    by_angle[:, :, : turns.shape[2]] = turns
    return position, np.concatenate([by_angle, turned], axis=2)
