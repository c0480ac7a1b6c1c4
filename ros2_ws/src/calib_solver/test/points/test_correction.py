# SPDX-License-Identifier: Apache-2.0
"""Eq. 12 on measured points: kept where encoders are eccentric, refused where geometry is all."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_calibration import kr5, on_a_rail
from simulated_points import tracked

from calib_model.instruments import Arm
from calib_model.kinematics import Correction, JointErrors, JointTerms
from calib_solver.error_models import CorrectionColumns
from calib_solver.fitting import Options
from calib_solver.points import PointIdentification, flange_of, held_out_points, identify_points
from calib_solver.points.correction import _slopes

NOISE = {'noise': 2e-5, 'turn_noise': 4e-5}
AUTO = Options('position', correction='auto', joint_errors=())


def eccentric(arm: Arm) -> Correction:
    values = 4e-4 * np.random.default_rng(19).normal(size=(4, arm.n))
    return Correction(arm.joint_names, JointErrors(JointTerms(2), values))


def identified(targets: int, stations: int, oriented: bool, **more) -> PointIdentification:
    return identify_points(
        tracked(33, 200, targets, stations, oriented, **NOISE, **more).measured, AUTO
    )


@pytest.mark.slow
@pytest.mark.parametrize(('targets', 'stations', 'oriented'), [(1, 1, False), (2, 5, True)])
def test_what_encoders_do_is_corrected_and_the_targets_stay(
    targets: int, stations: int, oriented: bool
):
    errors = eccentric(kr5())
    done = identified(targets, stations, oriented, correction=errors)
    assert done.choice_12.accepted
    part = 'stations' if stations > 3 else 'postures'
    assert f'{part} left out change by -' in done.choice_12.verdict
    assert done.corrected.phi < 0.5 * done.identified.phi
    np.testing.assert_array_equal(done.corrected.places.target, done.places.target)
    unseen = tracked(34, 60, targets, stations, oriented, **NOISE, correction=errors, world=33)
    held_out = held_out_points(unseen.measured, done)
    assert held_out.corrected.distance.mean() < 0.7 * held_out.identified.distance.mean()
    if oriented:
        assert held_out.corrected.angle.mean() < 0.7 * held_out.identified.angle.mean()


def test_it_is_refused_where_only_the_geometry_is_off():
    done = identified(1, 1, False)
    assert not done.choice_12.accepted
    assert done.choice_12.verdict.startswith('correction of eq. 12 refused: ')
    assert done.correction is None
    assert done.corrected is None


def test_few_points_do_not_judge_it():
    done = identify_points(tracked(35, 20, noise=2e-5).measured, AUTO)
    assert done.choice_12.verdict == (
        'correction of eq. 12 refused: 20 points are too few to judge it by'
    )


@pytest.mark.parametrize('arm', [kr5(), on_a_rail()], ids=['revolute', 'on a rail'])
def test_columns_are_what_the_correction_does_to_points_and_rotations(arm: Arm):
    measured = tracked(36, 60, 2, 2, True, arm=arm, **NOISE).measured
    done = identify_points(measured, Options('position', joint_errors=()))
    problem, places = done.problem, done.places
    columns = CorrectionColumns(arm.n, 2, 1)
    slopes = _slopes(problem, done.table, done.full, places, columns, np.arange(len(problem)))
    step = 1e-6 * np.random.default_rng(3).normal(size=columns.count)
    correction = columns.correction(step, (2, 1, 1), arm.joint_names, None)
    before = flange_of(problem, done.arm).residuals(problem, places)
    after = flange_of(problem, done.arm, correction).residuals(problem, places)
    for kind, tolerance in enumerate((2e-10, 2e-9)):
        moved = after[kind] - before[kind]
        assert np.abs(moved).max() > 1e-6
        predicted = slopes[kind][:, :, : columns.count] @ step
        np.testing.assert_allclose(moved, predicted, rtol=0, atol=tolerance)
