# SPDX-License-Identifier: Apache-2.0
"""New poses judge a finished calibration: by limits, or by what it states of itself."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import active, kr5, perturbed, simulate

from calib_model.bags import write_measurement
from calib_model.errors import CalibrationError
from calib_solver.acceptance import verify
from calib_solver.calibration import Sources, calibrate
from calib_solver.commands.verify import main
from calib_solver.fitting import Options
from calib_solver.results import parse_limits

pytestmark = [pytest.mark.timeout(120), pytest.mark.slow]


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A calibration, and new bags of its arm: as it was, and with an axis that slipped."""
    folder = tmp_path_factory.mktemp('verified')
    nominal = kr5()
    true = perturbed(nominal, np.random.default_rng(4))

    def bag(name, arm, seed, locations, poses):
        taken = simulate(arm, active(), seed, locations=locations, poses=poses, errors=0.0)
        generator = np.random.default_rng(seed)
        poses = taken.measured.poses
        joints = poses.joints + 3e-5 * generator.normal(size=poses.joints.shape)
        measured = replace(taken.measured, arm=nominal, poses=replace(poses, joints=joints))
        write_measurement(folder / name, measured)

    bag('bag', true, 31, 5, 12)
    slipped = true.geometry.copy()
    slipped[3, 1] += 1e-3
    bag('slipped', true.with_geometry(slipped), 33, 1, 5)
    for number in range(8):
        bag(f'new{number}', true, 40 + number, 1, 5)
    calibrate(Sources((str(folder / 'bag'),)), Options(), (), str(folder / 'out'))
    return folder


def found(made, name, limits=None):
    return verify(Sources((str(made / name),)), str(made / 'out'), more=limits)


def test_twenty_new_poses_of_an_unchanged_arm_are_as_good_as_stated(made):
    seen = [found(made, f'new{number}') for number in range(8)]
    assert sum(one.verdict == 'within' for one in seen) >= 6
    ratio = [one.position.rms / one.position.stated for one in seen]
    assert 0.75 < np.median(ratio) < 1.25


def test_an_axis_that_slipped_is_beyond_what_was_stated(made):
    one = found(made, 'slipped')
    assert one.verdict == 'beyond'
    assert one.position.rms > 3 * one.position.bound


def test_the_quality_is_that_of_the_stored_arm_on_the_new_poses(made):
    one = found(made, 'new1')
    record = one.record()
    assert record['quality']['position']['rms'] == pytest.approx(one.position.rms)
    assert record['quality']['position']['rms'] < 0.3 * record['nominal']['position']['rms']
    assert record['worst']['error'] == record['quality']['position']['max']
    assert record['poses'] == 20


def limits_file(folder, text):
    path = folder / 'limits.yaml'
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(('times', 'verdict', 'code'), [(1.01, 'passed', 0), (0.99, 'failed', 1)])
def test_limits_decide_and_the_exit_code_says_so(made, tmp_path, capsys, times, verdict, code):
    worst = found(made, 'new2').record()['quality']['distance']['max']
    limits = limits_file(tmp_path, f'limits: {{distance_max: {times * worst}, position_max: 0.01}}')
    words = [str(made / 'new2'), '--result', str(made / 'out'), '--limits', limits]
    assert main([*words, '--json', '--output', str(tmp_path / 'page')]) == code
    record = json.loads(capsys.readouterr().out)
    assert record['verdict'] == verdict
    assert [one['limit'] for one in record['limits']] == ['distance_max', 'position_max']
    assert [one['passed'] for one in record['limits']] == [not code, True]
    page = (tmp_path / 'page' / 'verification.html').read_text()
    assert '<svg' in page
    assert f'>{verdict}</p>' in page
    assert main(words) == code
    assert capsys.readouterr().out.splitlines()[-1] == verdict


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('limits: {distance_most: 0.1}', 'distance_most'),
        ('limits: {nonsense: 1.0e-4, distance_max: 1.0e-4}', 'nonsense'),
        ('limits: {distance_max: -1.0e-4}', 'distance_max'),
        ('limits: {distance_max: 25}', 'metres'),
        ('limits: {distance_max: soon}', 'distance_max'),
        ('limits: {}', 'expected some of'),
        ('distance_max: 0.001', 'limits'),
    ],
)
def test_limits_that_cannot_be_used_are_refused_by_name(text, named):
    with pytest.raises(CalibrationError, match=named):
        parse_limits(text, 'limits.yaml')


def test_a_limit_that_the_poses_cannot_tell_is_neither_passed_nor_failed(made, tmp_path, capsys):
    from calib_model.bags import read_measurement

    measured = read_measurement(made / 'new3')
    single = measured.poses.sphere == measured.poses.sphere[0]
    write_measurement(tmp_path / 'one', replace(measured, poses=measured.poses.take(single)))
    limits = limits_file(tmp_path, 'limits: {distance_max: 0.01}')
    words = [str(tmp_path / 'one'), '--result', str(made / 'out'), '--limits', limits]
    assert main(words) == 2
    assert 'distance_max cannot be judged' in capsys.readouterr().err


def test_results_without_stated_errors_are_refused_by_name(made, tmp_path, capsys):
    import shutil

    shutil.copytree(made / 'out', tmp_path / 'old')
    (tmp_path / 'old' / 'uncertainty.json').unlink()
    record = json.loads((tmp_path / 'old' / 'result.json').read_text())
    del record['files']
    (tmp_path / 'old' / 'result.json').write_text(json.dumps(record))
    assert main([str(made / 'new1'), '--result', str(tmp_path / 'old')]) == 2
    assert 'uncertainty.json: there is none' in capsys.readouterr().err
