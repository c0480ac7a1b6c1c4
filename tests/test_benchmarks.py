# SPDX-License-Identifier: Apache-2.0
"""The benchmarks run and their problems are what they say; nothing here looks at a clock."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]

from benchmarks import problems
from benchmarks.floating import floating_centers
from benchmarks.measuring import Part, Row, Target, table
from benchmarks.peers import Residuals, by_scipy
from benchmarks.reference import compare, write_problem
from benchmarks.solving import solve

from calib_model.kinematics import identifiable_table
from calib_solver.problem import Problem

POSES = 280
SPHERES = problems.LOCATIONS * len(problems.SPHERES)


@pytest.fixture(scope='module')
def problem() -> Problem:
    return Problem.of(problems.faro_measurement(POSES))


@pytest.mark.slow
def test_the_same_seed_makes_the_same_problem() -> None:
    one, same, other = (problems.faro_measurement(56, seed).poses.joints for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert not np.allclose(one, other)


@pytest.mark.slow
@pytest.mark.parametrize('active', [False, True])
def test_what_was_probed_is_a_ball_bar_with_joint_noise(
    active: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(problems, 'JOINT_NOISE', 0.0)
    monkeypatch.setattr(problems, 'READING_NOISE', 0.0)
    exact = Problem.of(problems.faro_measurement(POSES, active=active))
    table_ = identifiable_table(exact.measured.arm, exact.measured.probe)
    fit = solve(exact, table_)
    assert np.all(exact.counts == POSES // SPHERES)
    assert fit.phi_initial > 1e-5
    assert fit.quadratic.phi < 1e-15


@pytest.mark.slow
def test_more_poses_than_the_pool_are_still_all_different() -> None:
    count = (problems.POOL + 20) * SPHERES
    measured = problems.faro_measurement(count)
    assert len(measured.checked().poses) == count
    assert len(np.unique(measured.poses.joints, axis=0)) == count


def test_the_reference_gets_the_problem_in_its_own_format(problem: Problem, tmp_path: Path) -> None:
    start = problems.reference_table(problem.measured)
    file = tmp_path / 'problem.bin'
    write_problem(file, problem, start.nominal[start.free_columns])
    content = file.read_bytes()
    pairs = 7 * 6
    assert struct.unpack_from('<3i', content) == (POSES, SPHERES, pairs)
    assert len(content) == 12 + POSES * (6 * 8 + 4) + SPHERES * 4 + pairs * (8 + 8) + 27 * 8
    assert struct.unpack_from('<6d', content, 12) == tuple(problem.joints[0])
    assert struct.unpack('<3d', content[-24:]) == (0.0, 0.139, 0.055)


def test_residuals_given_to_scipy_are_eq_11_and_so_is_their_minimum(problem: Problem) -> None:
    free = identifiable_table(problem.measured.arm, problem.measured.probe)
    residuals = Residuals(problem, free)
    fit = solve(problem, free)
    at = fit.x / residuals.scale
    assert float(np.sum(residuals(at) ** 2)) == pytest.approx(fit.quadratic.phi, rel=1e-9)
    step = 1e-4 * np.random.default_rng(0).normal(size=len(at))
    by_difference = (residuals(at + step) - residuals(at - step)) / 2
    np.testing.assert_allclose(residuals.jacobian(at) @ step, by_difference, atol=1e-13)
    found = by_scipy(residuals, with_jacobian=True)
    assert 2 * found.cost == pytest.approx(fit.quadratic.phi, rel=1e-9)


def test_floating_centers_lower_phi_as_a_fit_of_the_centers_does(problem: Problem) -> None:
    from scipy.optimize import least_squares

    from calib_solver.fitting import distance_repeatability, repeatability_weights
    from calib_solver.problem import accumulate

    free = problems.reference_table(problem.measured)
    sums = accumulate(problem, free, free.nominal)
    weight = np.sqrt(repeatability_weights(sums) * sums.count)[:, None]
    first, second = problem.pairs.T

    def with_centers(x: np.ndarray) -> np.ndarray:
        moved = sums.center + x.reshape(-1, 3)
        distance = np.linalg.norm(moved[first] - moved[second], axis=1) - problem.nominal
        return np.concatenate([(weight * x.reshape(-1, 3)).reshape(-1), distance])

    centers = least_squares(with_centers, np.zeros(3 * SPHERES), xtol=1e-15, ftol=1e-15)
    plain = distance_repeatability(problem, sums).phi
    fixed_part = plain - float(np.sum(with_centers(np.zeros(3 * SPHERES)) ** 2))
    floating = floating_centers(problem, sums).phi
    assert floating < plain
    assert floating == pytest.approx(fixed_part + 2 * centers.cost, rel=1e-6)


def test_a_missing_reference_is_said_not_raised(tmp_path: Path) -> None:
    part = compare(tmp_path / 'nowhere.cpp', POSES, 1)
    assert 'not installed' in table(part)
    assert 'nowhere.cpp' in table(part)


@pytest.mark.system
def test_a_reference_that_does_not_build_is_said_not_raised(tmp_path: Path) -> None:
    source = tmp_path / 'broken.cpp'
    source.write_text('#include <no_such_header>\n')
    assert 'not installed' in table(compare(source, POSES, 1))


def test_a_missed_target_is_named() -> None:
    rows = (Row('one', 1.0), Row('other', 2.0, 2.0, 'one'))
    text = table(Part('title', rows, (Target('speed', 3.0, 2.0), Target('size', 1.0, 2.0))))
    assert 'MISSED: speed' in text
    assert 'holds: size' in text


@pytest.mark.system
@pytest.mark.timeout(210)
def test_every_part_runs_and_is_recorded(tmp_path: Path) -> None:
    output = tmp_path / 'bench.json'
    command = [
        sys.executable,
        '-m',
        'benchmarks.run',
        '--poses',
        '112',
        '--rounds',
        '1',
        '--sizes',
        '112',
        '280',
        '--reference',
        str(tmp_path / 'none.cpp'),
        '--output',
        str(output),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    parts = json.loads(output.read_text(encoding='utf-8'))['parts']
    assert set(parts) == {
        'reference',
        'scipy',
        'pybotics',
        'kernel',
        'scale',
        'command',
        'identify',
        'points',
    }
    sizes = [row['figures']['poses'] for row in parts['scale']['rows']]
    assert sizes == [112, 280, 112, 280, 280]
    assert all(row['figures']['bytes'] > 1 << 20 for row in parts['scale']['rows'])
    assert all(target['met'] for target in parts['scipy']['targets'] + parts['kernel']['targets'])
