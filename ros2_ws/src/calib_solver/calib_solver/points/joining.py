# SPDX-License-Identifier: Apache-2.0
"""Points that go with others: of several bags, or held out from an identification."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics import Correction
from calib_model.measured_points import PointMeasurement, PointSet
from calib_solver.points.identified import PointIdentification
from calib_solver.points.places import Places
from calib_solver.points.problem import PointProblem
from calib_solver.points.quality import (
    HeldOutPoints,
    PointQuality,
    flange_of,
    known_quality,
    refuse_unknown_targets,
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
    problem = PointProblem.of(measured, targets)
    problem = problem.turns_weighing(done.problem.turn_weight).weighed_as(done.problem.unit_sigma)
    problem.refuse_too_few()

    def judged(arm: Arm, places: Places, correction: Correction | None = None) -> PointQuality:
        return known_quality(problem, flange_of(problem, arm, correction), places, stations)

    corrected = done.corrected
    return HeldOutPoints(
        problem,
        judged(done.problem.arm, done.initial.places),
        judged(done.arm, done.identified.places, done.model),
        judged(done.arm, corrected.places, done.correction) if corrected is not None else None,
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
