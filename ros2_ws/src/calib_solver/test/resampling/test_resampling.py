# SPDX-License-Identifier: Apache-2.0
"""Doing it again says what the stated uncertainties say, the same whoever does it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import kr5, passive, simulate

from calib_model.bags import write_measurement
from calib_model.errors import CalibrationError, DataError
from calib_solver.calibration import Calibration, summary_text
from calib_solver.commands.identify import run
from calib_solver.fitting import Options
from calib_solver.identification import identify
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.resampling.processes import in_processes
from calib_solver.resampling.resampling import Plan, exact_centers, resample
from calib_solver.results import result_record

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
ALONE = in_processes(1)


@pytest.fixture(scope='module')
def done():
    """A calibration whose poses scatter as the model says."""
    return identify(simulate(kr5(), passive(), 71, locations=8, poses=12, noise=1e-4).measured)


@pytest.fixture(scope='module')
def resampled(done):
    return resample(done, Plan(300, 200, 5), ALONE)


def test_the_monte_carlo_confirms_the_stated_uncertainties(done, resampled):
    ratio = resampled.monte_carlo.standard / done.uncertainty.standard
    assert resampled.monte_carlo.converged == 300
    # a standard deviation from 300 draws is unsure by 4 %
    assert np.abs(ratio - 1).max() < 0.2
    assert abs(np.median(ratio) - 1) < 0.05


@pytest.mark.parametrize('objective', ['distance', 'position'])
def test_and_those_of_the_other_objectives(objective):
    measured = simulate(kr5(), passive(), 72, locations=8, poses=12, noise=1e-4).measured
    done = identify(measured, Options(objective))
    repeated = resample(done, Plan(monte_carlo=200), ALONE).monte_carlo
    ratio = repeated.standard / done.uncertainty.standard
    assert np.abs(ratio - 1).max() < 0.25
    assert abs(np.median(ratio) - 1) < 0.1


def test_the_bootstrap_over_locations_is_of_the_same_order(done, resampled):
    ratio = resampled.bootstrap.standard / done.uncertainty.standard
    assert resampled.bootstrap.converged == 200
    assert 0.7 < np.median(ratio) < 1.4
    assert ratio.min() > 0.35
    assert ratio.max() < 2.8


def test_positions_are_as_unsure_as_stated(done, resampled):
    record = result_record(done, None, resampled)
    stated = record['diagnostics']['position_uncertainty_rms']
    found = record['resampling']['monte_carlo']['position_uncertainty_rms']
    assert found == pytest.approx(stated, rel=0.1)
    found = record['resampling']['bootstrap']['position_uncertainty_rms']
    assert found == pytest.approx(stated, rel=0.6)


def test_the_record_has_each_free_parameter_beside_its_stated_uncertainty(done, resampled):
    record = result_record(done, None, resampled)
    json.dumps(record, allow_nan=False)
    free = [p for p in record['parameters'] if p['free']]
    told = record['resampling']['parameters']
    assert [p['name'] for p in told] == [p['name'] for p in free]
    assert [p['analytic'] for p in told] == [p['standard_uncertainty'] for p in free]
    assert [p['monte_carlo'] for p in told] == list(resampled.monte_carlo.standard)
    assert [p['bootstrap'] for p in told] == list(resampled.bootstrap.standard)
    text = summary_text(Calibration(done, None, record, ()))
    assert 'Monte Carlo, 300 repetitions: ' in text
    assert 'bootstrap over locations, 200 repetitions: ' in text


def test_what_was_not_asked_for_is_null(done):
    assert result_record(done)['resampling'] is None
    only = resample(done, Plan(monte_carlo=2), ALONE)
    record = result_record(done, None, only)['resampling']
    assert record['bootstrap'] is None
    assert {p['bootstrap'] for p in record['parameters']} == {None}


def test_neither_the_number_of_workers_nor_of_repetitions_changes_one(done, resampled):
    again = resample(done, Plan(8, 8, 5), in_processes(2))
    for name in ('monte_carlo', 'bootstrap'):
        few, many = getattr(again, name).deviation, getattr(resampled, name).deviation
        np.testing.assert_array_equal(few, many[:8])


def test_another_seed_draws_others(done, resampled):
    other = resample(done, Plan(4, 4, 6), ALONE)
    for name in ('monte_carlo', 'bootstrap'):
        drawn = getattr(resampled, name).deviation[:4]
        assert not np.isclose(getattr(other, name).deviation, drawn).any(axis=1).all()


def test_the_monte_carlo_starts_from_poses_that_the_identified_arm_explains_wholly(done):
    probe = done.probe
    exact = replace(done.problem, centers=exact_centers(done))
    quality = assess(exact, done.arm, probe)
    assert quality.phi < 1e-24
    moved = np.linalg.norm(exact.centers - done.problem.centers, axis=1)
    assert np.sqrt(np.mean(moved**2)) == pytest.approx(np.sqrt(3) * done.uncertainty.noise, rel=0.1)


def test_without_noise_and_with_a_perfect_certificate_nothing_varies():
    measured = simulate(kr5(), passive(), 73, locations=5, poses=8).measured
    measured = replace(measured, gauge=replace(measured.gauge, constant=0.0, proportional=0.0))
    both = resample(identify(measured), Plan(4, 4), ALONE)
    assert both.monte_carlo.standard.max() < 1e-9
    assert both.bootstrap.standard.max() < 1e-9


def test_a_gauge_that_moved_stays_apart_when_its_location_is_drawn():
    measured = simulate(kr5(), passive(), 74, locations=5, poses=10, noise=1e-4).measured
    poses = measured.poses
    there = (poses.location == 2) & (poses.sphere == 6)
    mislabelled = replace(
        poses,
        sphere=np.where(
            there, 10, np.where((poses.location == 2) & (poses.sphere == 10), 6, poses.sphere)
        ),
    )
    done = identify(replace(measured, poses=mislabelled))
    assert done.warnings
    repeated = resample(done, Plan(bootstrap=30), ALONE).bootstrap
    assert repeated.standard.max() < 10 * done.uncertainty.standard.max()


@pytest.mark.parametrize(
    ('plan', 'said'),
    [
        (Plan(monte_carlo=1), 'monte-carlo 1: expected 0, or 2 or more'),
        (Plan(bootstrap=-3), 'bootstrap -3: expected 0, or 2 or more'),
        (Plan(monte_carlo=2, seed=-1), 'seed -1: expected zero or more'),
    ],
)
def test_a_plan_that_makes_no_sense_is_refused(done, plan, said):
    with pytest.raises(DataError, match=said):
        resample(done, plan, ALONE)


def test_one_location_has_nothing_to_draw_from():
    measured = simulate(kr5(), passive(), 75, locations=1, poses=8, noise=1e-4).measured
    with pytest.raises(DataError, match='draws whole gauge locations, and there is 1'):
        resample(identify(measured), Plan(bootstrap=10), ALONE)


def test_a_bootstrap_that_cannot_be_is_refused_before_anything_is_identified(tmp_path):
    measured = simulate(kr5(), passive(), 75, locations=1, poses=8, noise=1e-4).measured
    write_measurement(tmp_path / 'bag', measured)
    with pytest.raises(DataError, match='whole gauge locations'):
        run([str(tmp_path / 'bag'), '--bootstrap', '5', '--output', str(tmp_path / 'out')])
    assert not (tmp_path / 'out').exists()


def fall_over(shared, item):
    os._exit(7)


def test_a_worker_that_dies_is_one_clear_error():
    with pytest.raises(CalibrationError, match='a worker process died'):
        in_processes(2)(fall_over, None, [1, 2, 3], lambda: None)


def children_of(pid):
    listing = subprocess.run(['ps', '-o', 'pid=', '--ppid', str(pid)], capture_output=True)
    return [int(number) for number in listing.stdout.split()]


def test_ctrl_c_ends_it_at_once_without_a_traceback_or_a_process_left(tmp_path):
    measured = simulate(kr5(), passive(), 76, locations=5, poses=8, noise=1e-4).measured
    write_measurement(tmp_path / 'bag', measured)
    words = [tmp_path / 'bag', '--monte-carlo', '20000', '--output', tmp_path / 'out']
    process = subprocess.Popen(
        [sys.executable, '-m', 'calib_solver.commands.identify', *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, 'CALIB_THREADS': '2'},
    )
    line = process.stderr.readline()
    assert 'of 20000 repetitions, Monte Carlo' in line
    children = children_of(process.pid)
    assert len(children) >= 2
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers as well
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert 'Traceback' not in err
    assert out == ''
    assert not (tmp_path / 'out').exists()
    deadline = time.monotonic() + 10
    while any(os.path.exists(f'/proc/{child}') for child in children):
        assert time.monotonic() < deadline, 'workers live on'
        time.sleep(0.05)


def test_two_hundred_repetitions_of_1680_poses_all_come_back():
    measured = simulate(kr5(), passive(), 77, locations=10, poses=42, noise=1e-4).measured
    done = identify(measured)
    assert len(Problem.of(measured).joints) == 1680
    repeated = resample(done, Plan(monte_carlo=200), in_processes(2)).monte_carlo
    assert len(repeated.deviation) == 200 and np.isfinite(repeated.deviation).all()
