# SPDX-License-Identifier: Apache-2.0
"""New points judge a calibration by measured points."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate
from simulated_points import tracked

from calib_model.bags import write_measurement, write_points
from calib_model.errors import CalibrationError
from calib_model.measured_points import PointMeasurement
from calib_solver.acceptance import compare, verify, write_verification
from calib_solver.calibration import Sources, calibrate_points
from calib_solver.commands.verify import main
from calib_solver.fitting import Options

NOISE = 4e-5
pytestmark = pytest.mark.timeout(120)


def new_points(seed: int, first: int = 60) -> PointMeasurement:
    """Twenty of the same arm, targets and stations, in postures never measured."""
    all_of_them = tracked(seed, first + 20, 2, 2, noise=NOISE, world=3).measured
    return replace(all_of_them, points=all_of_them.points.take(np.arange(first, first + 20)))


def moved(measured: PointMeasurement) -> PointMeasurement:
    """As another station has them, which was never used."""
    points = measured.points
    return replace(
        measured,
        points=replace(points, station=points.station + 5, position=points.position[:, [1, 2, 0]]),
    )


@pytest.fixture(scope='module')
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('verified')
    options = Options('position', quick=True)
    for name, seed in (('out', 31), ('later', 32)):
        bag = folder / f'{name}_bag'
        write_points(bag, tracked(seed, 60, 2, 2, True, NOISE, 9e-5, world=3).measured)
        calibrate_points(Sources((str(bag),)), options, output=str(folder / name))
    for number in range(6):
        unseen = new_points(40 + number, 60 + 20 * number)
        write_points(folder / f'new{number}', unseen)
        write_points(folder / f'moved{number}', moved(unseen))
    slipped = new_points(50)
    joints = slipped.points.joints.copy()
    joints[:, 1] += 5e-4
    spoilt = replace(slipped, points=replace(slipped.points, joints=joints))
    write_points(folder / 'slipped', spoilt)
    write_points(folder / 'other_target', tracked(51, 12, 3, noise=NOISE, world=3).measured)
    probed = simulate(kr5(), active(), 5, locations=2, poses=5).measured
    write_measurement(folder / 'probed', probed)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize('kind', ['new', 'moved'])
def test_new_points_are_as_good_as_stated(made: Path, kind: str):
    seen = [verify(Sources((str(made / f'{kind}{n}'),)), str(made / 'out')) for n in range(6)]
    assert sum(one.within for one in seen) >= 4
    ratio = [one.position.rms / one.position.stated for one in seen]
    assert 0.85 < np.sqrt(np.mean(np.square(ratio))) < 1.15


@pytest.mark.slow
def test_several_targets_whose_rotation_nobody_measured_are_as_good_as_stated(tmp_path: Path):
    """Columns that no point tells must have no part in what is stated."""
    within, ratio = 0, []
    for seed in range(4):
        folder, known = tmp_path / str(seed), 30 + seed
        measured = tracked(seed, 80, 3, 2, noise=NOISE, world=known).measured
        first = measured.points.take(np.arange(60))
        write_points(folder / 'bag', replace(measured, points=first))
        rest = replace(measured, points=measured.points.take(np.arange(60, 80)))
        write_points(folder / 'new', moved(rest))
        options = Options('position', quick=True)
        calibrate_points(Sources((str(folder / 'bag'),)), options, output=str(folder / 'out'))
        found = verify(Sources((str(folder / 'new'),)), str(folder / 'out'))
        within += found.within
        ratio.append(found.position.rms / found.position.stated)
    assert within >= 3
    assert 0.85 < np.sqrt(np.mean(np.square(ratio))) < 1.2


def test_each_target_is_held_to_what_its_own_points_scattered(tmp_path: Path):
    measured = tracked(14, 260, 2, 1, noise=NOISE, world=14).measured
    points, shake = measured.points, np.random.default_rng(3)
    off = np.where(points.target == '2', 9e-5, 0.0)[:, None] * shake.normal(size=(260, 3))
    points = replace(points, position=points.position + off)
    seen = np.arange(260) < 160
    write_points(tmp_path / 'bag', replace(measured, points=points.take(np.flatnonzero(seen))))
    options = Options('position', quick=True)
    calibrate_points(Sources((str(tmp_path / 'bag'),)), options, output=str(tmp_path / 'out'))
    stated = []
    for target in '12':
        rows = np.flatnonzero(~seen & (points.target == target))
        write_points(tmp_path / target, replace(measured, points=points.take(rows)))
        found = verify(Sources((str(tmp_path / target),)), str(tmp_path / 'out'))
        assert found.position.rms == pytest.approx(found.position.stated, rel=0.2)
        stated.append(found.position.stated)
    assert 1.7 < stated[1] / stated[0] < 2.8


def test_points_of_another_stated_sigma_are_held_to_that(tmp_path: Path):
    """A better tracker calibrated, a worse one verifies."""
    worse, ratio = 4.0, []
    for seed in range(4):
        folder = tmp_path / str(seed)
        first = tracked(seed, 60, 1, 1, noise=NOISE, world=70 + seed).measured
        new = tracked(9 + seed, 80, 1, 1, noise=worse * NOISE, world=70 + seed).measured
        rows = np.arange(60, 80)
        for name, measured, sigma in (
            ('bag', first.points, NOISE),
            ('new', new.points.take(rows), worse * NOISE),
        ):
            points = replace(measured, sigma=np.full(len(measured), sigma))
            write_points(folder / name, replace(first, points=points))
        options = Options('position', quick=True)
        calibrate_points(Sources((str(folder / 'bag'),)), options, output=str(folder / 'out'))
        found = verify(Sources((str(folder / 'new'),)), str(folder / 'out'))
        ratio.append(found.position.rms / found.position.stated)
        assert found.notes == ()
    assert 0.85 < np.sqrt(np.mean(np.square(ratio))) < 1.2
    bare = replace(new, points=new.points.take(rows))
    write_points(tmp_path / 'bare', bare)
    found = verify(Sources((str(tmp_path / 'bare'),)), str(tmp_path / '3' / 'out'))
    assert found.notes == (
        "the calibration's points state a sigma and these do not: they are taken to be as good",
    )


def test_an_axis_that_slipped_is_beyond_what_was_stated_and_on_the_page(made: Path):
    found = verify(Sources((str(made / 'slipped'),)), str(made / 'out'))
    assert found.verdict == 'beyond'
    page = write_verification(found, str(made)).read_text()
    for words in ('beyond what it states', 'position error, rms', 'station'):
        assert words in page


def test_limits_pass_or_fail_a_calibration(made: Path, capsys):
    limits = made / 'limits.yaml'
    told = [str(made / 'new0'), '--result', str(made / 'out'), '--limits', str(limits), '--json']
    limits.write_text('limits: {position_max: 0.0005}')
    assert main(told) == 0
    record = json.loads(capsys.readouterr().out)
    assert record['verdict'] == 'passed'
    assert record['quality']['position']['count'] == record['poses'] == 20
    assert set(record['worst']) == {'pose', 'target', 'station', 'error'}
    limits.write_text('limits: {position_max: 0.00005}')
    assert main(told) == 1
    limits.write_text('limits: {distance_max: 0.0005}')
    assert main(told) == 2
    assert 'distance_max cannot be judged' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('bag', 'words'),
    [('probed', 'calibrated by measured points'), ('other_target', 'target 3 was not identified')],
)
def test_what_the_calibration_knows_nothing_of_is_refused(made: Path, bag: str, words: str):
    with pytest.raises(CalibrationError, match=words):
        verify(Sources((str(made / bag),)), str(made / 'out'))


def test_two_calibrations_of_an_unchanged_arm_differ_by_chance_alone(made: Path):
    found = compare([str(made / 'out'), str(made / 'later')])
    record = found.record()['steps'][0]
    assert record['verdict'] == 'no change beyond uncertainty'
    assert not any(one['name'].startswith('probe_') for one in record['parameters'])
    assert 0 < record['positions']['rms'] < 4 * record['positions']['standard_uncertainty']
