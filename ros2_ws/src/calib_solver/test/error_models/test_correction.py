# SPDX-License-Identifier: Apache-2.0
"""Eq. 12's correction helps where encoders are eccentric, and is refused where only geometry is."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import result_schema
from simulated_calibration import iiwa, kr5, passive, simulate
from simulated_joint_errors import off_by, parts, true_errors

from calib_model.bags import write_measurement
from calib_model.descriptions import parse_arm, parse_correction, read_description
from calib_model.errors import DataError
from calib_model.kinematics import CorrectedArm, JointErrors, JointTerms
from calib_solver.calibration import Sources, calibrate, evaluation_record, summary_text
from calib_solver.error_models.correction import CorrectionColumns
from calib_solver.error_models.validation_gain import Gain
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.results import result_record

pytestmark = pytest.mark.timeout(60)
AUTO = Options(correction='auto', joint_errors=())


@pytest.fixture(scope='module')
def plain():
    """Seven locations of an arm off in its geometry alone; the seventh is held out."""
    return simulate(kr5(), passive(), 83, locations=7, poses=25)


@pytest.fixture(scope='module')
def eccentric(plain):
    return off_by(plain, true_errors(('encoder',)))


@pytest.fixture(scope='module')
def done(eccentric):
    return identify(parts(eccentric)[0], AUTO)


def test_it_lowers_two_sigma_where_nothing_was_fitted_by_a_fifth_and_more(eccentric, done):
    assert done.choice_12.accepted
    unseen = parts(eccentric)[1]
    before = assess(unseen, done.arm, done.probe)
    after = assess(unseen, done.arm, done.probe, done.correction)
    assert after.spheres.two_sigma.mean() < 0.8 * before.spheres.two_sigma.mean()
    assert done.corrected.spheres.two_sigma.mean() < 0.8 * done.identified.spheres.two_sigma.mean()


@pytest.mark.slow
def test_what_locations_left_out_promise_is_what_they_keep(done):
    """The linear account of cross-validation, against the identification done anew without."""
    choice = done.choice_12
    before, after = choice.two_sigma
    assert after < before
    problem = done.problem
    poses = problem.measured.poses
    sums, terms = np.zeros(2), 0
    for location in np.unique(poses.location):
        rest = replace(problem.measured, poses=poses.take(poses.location != location))
        left = Problem.of(replace(problem.measured, poses=poses.take(poses.location == location)))
        again = identify(rest, replace(AUTO, correction='harmonic', loss='plain'))
        for i, correction in enumerate((None, again.correction)):
            sigma = assess(left, again.arm, again.probe, correction).spheres.two_sigma
            sums[i] += (sigma**2).sum()
        terms += sigma.size
    anew = np.sqrt(sums / terms)
    # the D-H parameters, too, are fitted anew here, so both are somewhat worse
    assert anew[1] / anew[0] == pytest.approx(after / before, abs=0.12)


@pytest.mark.slow
@pytest.mark.parametrize('noise', [0.0, 2e-5])
def test_it_is_refused_where_only_the_geometry_is_off(plain, noise):
    nothing = JointErrors(JointTerms(2), np.zeros((4, 6)))
    measured = off_by(plain, nothing, noise).measured
    found, bare = identify(measured, AUTO), identify(measured, Options(joint_errors=()))
    assert not found.choice_12.accepted
    assert found.choice_12.verdict.startswith('correction of eq. 12 refused: ')
    assert '\n' not in found.choice_12.verdict
    assert found.correction is None
    assert found.corrected is None
    np.testing.assert_array_equal(found.full, bare.full)


@pytest.mark.slow
def test_it_is_refused_on_seven_joints_of_which_only_the_geometry_is_off():
    measured = simulate(iiwa(), passive(), 84, locations=6, noise=3e-5).measured
    assert not identify(measured, AUTO).choice_12.accepted


def test_columns_are_what_the_correction_does(done):
    problem, columns = done.problem, CorrectionColumns(6, 2, 2)
    rows = np.arange(0, len(problem.joints), 41)
    point, slope = columns.at(problem, done.table, done.full, rows)
    step = 1e-6 * np.random.default_rng(3).normal(size=columns.count)
    correction = columns.correction(step, (2, 2, 1), done.arm.joint_names, None)
    p_flange = done.probe.flange_T_probe.apply(problem.centers[rows])
    moved = CorrectedArm(done.arm, correction).points(problem.joints[rows], p_flange)
    np.testing.assert_allclose(moved - point, slope @ step, rtol=0, atol=1e-10)
    assert np.abs(moved - point).max() > 1e-6


@pytest.mark.slow
def test_asked_for_in_any_case_it_is_taken(plain):
    done = identify(plain.measured, Options(correction='harmonic'))
    assert done.correction is not None
    assert 'taken as asked' in done.choice_12.verdict


@pytest.mark.slow
@pytest.mark.parametrize('objective', ['distance', 'position'])
def test_it_serves_other_objectives_too(eccentric, objective):
    done = identify(parts(eccentric)[0], Options(objective, correction='auto', joint_errors=()))
    # what eq. 13 leaves of the repeatability is geometry, and too much for a correction
    assert done.choice_12.accepted == (objective == 'position')
    result_schema.result(json.loads(json.dumps(result_record(done), allow_nan=False)))


def test_too_few_locations_and_unknown_choices_are_refused(plain):
    poses = plain.measured.poses
    few = replace(plain.measured, poses=poses.take(poses.location < 3))
    done = identify(few, AUTO)
    assert done.choice_12.verdict == (
        'correction of eq. 12 refused: 2 locations, expected 4 to judge it by'
    )
    result_schema.result(json.loads(json.dumps(result_record(done), allow_nan=False)))
    with pytest.raises(DataError, match="no correction 'on': expected one of off, auto, harmonic"):
        identify(few, Options(correction='on'))


@pytest.mark.slow
def test_what_is_written_is_what_evaluate_applies(eccentric, tmp_path):
    measured = eccentric.measured
    last = measured.poses.location == 7
    for name, which in (('seen', ~last), ('held', last)):
        poses = measured.poses.take(which)
        write_measurement(tmp_path / name, replace(measured, poses=poses))
    sources = Sources((str(tmp_path / 'seen'),))
    test, out = [str(tmp_path / 'held')], tmp_path / 'out'
    options = Options(correction='auto', joint_errors=('encoder',))
    finished = calibrate(sources, options, test, str(out))
    record = json.loads((out / 'result.json').read_text())
    result_schema.result(record)
    assert record['joint_errors']['identified'] == ['encoder']
    assert out / 'correction.yaml' in finished.written
    lines = summary_text(finished)
    assert finished.done.choice_12.verdict in lines
    assert 'joint errors, encoder identified' in lines
    given = Sources(tuple(test), str(out / 'arm.yaml'), str(out / 'probe.yaml'))
    told = evaluation_record(given, str(out / 'correction.yaml'))
    expected = record['correction']['quality'] or record['quality']
    for group in ('two_sigma', 'distance'):
        expected_mean = expected['test'][group]['mean']
        assert told[group]['mean'] == pytest.approx(expected_mean, rel=1e-9)
    bare = evaluation_record(given)
    assert bare['two_sigma']['mean'] > 1.2 * told['two_sigma']['mean']
    beyond = read_description(out / 'correction.yaml', parse_correction)
    arm = read_description(out / 'arm.yaml', parse_arm)
    p_flange = finished.done.probe.flange_T_probe.apply(finished.done.problem.centers)
    CorrectedArm(arm, beyond).points(finished.done.problem.joints, p_flange)
    # another run in the same folder without it leaves no correction of an arm that is gone
    calibrate(sources, Options(joint_errors=()), (), str(out))
    assert not (out / 'correction.yaml').exists()


def test_what_is_not_known_of_it_is_added_to_every_stated_position(eccentric):
    done = identify(parts(eccentric)[0], replace(AUTO, correction='harmonic'))
    alone = done.workspace.uncertainty(done.uncertainty.covariance)
    assert (done.position_uncertainty > alone).all()
    coefficients = done.choice_12.coefficients
    assert np.linalg.eigvalsh(coefficients.covariance).min() > 0
    assert identify(parts(eccentric)[0], Options(joint_errors=())).choice_12 is None


def test_a_gain_that_costs_one_location_anything_is_none():
    gain = Gain(-0.5, 0.05, 1e-5, 6e-6, 6, worst=0.01)
    assert gain.convinces and not gain.harmless
    assert replace(gain, worst=-0.01).harmless
