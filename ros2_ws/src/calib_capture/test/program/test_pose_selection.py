# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_capture.program.planner import Planner
from calib_capture.program.pose_selection import (
    Information,
    Pool,
    SelectionSettings,
    choose,
    exchanged,
    information_matrix,
    log_det,
)
from calib_capture.program.program import ProgramSettings
from calib_model.arrays import frozen

pytestmark = pytest.mark.timeout(60)
WANTED = 6


@pytest.fixture(scope='module')
def information(kr5, probe, gauge):
    return Information(kr5, probe, gauge)


@pytest.fixture(scope='module')
def pools(information, kr5, gauge, placements):
    """Postures anywhere: what they tell does not ask whether they can be reached."""
    generator = np.random.default_rng(0)
    limits = np.clip(kr5.limits, -np.pi, np.pi)
    found = []
    for location in (1, 2):
        for sphere in (1, 6, 14):
            q = generator.uniform(*limits.T, (30, 6))
            seats = generator.uniform(-1e-3, 1e-3, (30, 3))
            center = placements[location].apply(gauge.center(sphere))
            found.append(Pool(location, sphere, center, information.rows(q, seats)))
    return found


def test_information_is_that_of_centred_poses_and_distances(information, pools, gauge):
    """With certain centres' part eliminated: eq. 11's two terms, each at its own weight."""
    chosen = [np.arange(WANTED) for _ in pools]
    free = len(information.known)
    expected = information.known
    for location in (1, 2):
        own = [pool for pool in pools if pool.location == location]
        rows = [pool.rows[:WANTED, :, :free] * information.settings.noise for pool in own]
        means = np.array([each.mean(axis=0) for each in rows])
        for each, mean in zip(rows, means, strict=True):
            centred = (each - mean).reshape(-1, free)
            expected = expected + centred.T @ centred / information.settings.noise**2
        pairs = [(0, 1), (0, 2), (1, 2)]
        slopes, units, sure = [], np.zeros((3, 9)), []
        for k, (i, j) in enumerate(pairs):
            between = own[i].center - own[j].center
            unit = between / np.linalg.norm(between)
            slopes.append(unit @ (means[i] - means[j]))
            units[k, 3 * i : 3 * i + 3], units[k, 3 * j : 3 * j + 3] = unit, -unit
            length = gauge.distance(own[i].sphere, own[j].sphere)
            sure.append((gauge.distance_uncertainty(length) / 2) ** 2)
        # distances between means: their noise is the poses', shared where they share a sphere
        covariance = np.diag(sure) + units @ units.T * information.settings.noise**2 / WANTED
        slopes = np.array(slopes)
        expected = expected + slopes.T @ np.linalg.solve(covariance, slopes)
    found = information_matrix(information, pools, chosen)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize('seed', range(10))
def test_a_choice_tells_at_least_as_much_as_what_it_began_with(information, pools, seed):
    generator = np.random.default_rng(seed)
    mixed = [replace(pool, rows=pool.rows[generator.permutation(30)]) for pool in pools]
    choice = choose(information, mixed, WANTED)
    first = [np.arange(WANTED) for _ in mixed]
    assert choice.before == pytest.approx(log_det(information_matrix(information, mixed, first)))
    assert choice.after == pytest.approx(
        log_det(information_matrix(information, mixed, choice.chosen))
    )
    assert choice.after > choice.before + 0.5
    assert all(len(set(rows.tolist())) == WANTED for rows in choice.chosen)


def test_a_choice_tells_more_than_any_of_many_random_ones(information, pools):
    generator = np.random.default_rng(1)
    best = max(
        log_det(
            information_matrix(
                information, pools, [generator.permutation(30)[:WANTED] for _ in pools]
            )
        )
        for _ in range(200)
    )
    assert choose(information, pools, WANTED).after > best


def test_exchanges_gain_what_the_determinant_says():
    generator = np.random.default_rng(2)
    rows = generator.normal(size=(20, 3, 8))
    known = 0.1 * np.eye(8)

    def told(chosen):
        flat = rows[chosen].reshape(-1, 8)
        return np.linalg.slogdet(known + flat.T @ flat)[1]

    begin = np.arange(5)
    flat = rows[begin].reshape(-1, 8)
    end = exchanged(np.linalg.inv(known + flat.T @ flat), rows, begin)
    assert len(end) == 5
    assert told(end) > told(begin)
    # a plateau: giving up the pose that tells least brings back no better one
    least = max(end, key=lambda i: told(np.setdiff1d(end, [i])))
    kept = np.setdiff1d(end, [least])
    assert max(told(np.append(kept, i)) for i in range(20) if i not in kept) <= told(end) + 1e-9


def test_spheres_with_few_candidates_keep_them_all(information, pools):
    def with_only(count, sphere):
        return [
            replace(pool, rows=pool.rows[: (count if i == sphere else 30)])
            for i, pool in enumerate(pools)
        ]

    scarce, empty = with_only(3, 1), with_only(0, 2)
    assert choose(information, scarce, WANTED).chosen[1].tolist() == [0, 1, 2]
    assert [len(rows) for rows in choose(information, empty, WANTED).chosen] == [6, 6, 0, 6, 6, 6]


def test_less_noise_and_more_poses_make_positions_surer(information, kr5, probe, gauge, pools):
    few, many = ([np.arange(n) for _ in pools] for n in (5, 30))
    unsure = information.position_uncertainty(information_matrix(information, pools, few))
    sure = information.position_uncertainty(information_matrix(information, pools, many))
    assert sure < unsure < information.position_uncertainty(information.known)
    quiet = Information(kr5, probe, gauge, SelectionSettings(noise=1e-6))
    rows = [replace(pool, rows=pool.rows * 20) for pool in pools]
    assert quiet.position_uncertainty(information_matrix(quiet, rows, few)) < unsure


@pytest.mark.slow
def test_a_program_of_a_larger_pool_is_surer_than_the_first_poses(kr5, probe, gauge, placements):
    plain = ProgramSettings(poses_per_sphere=10)
    expected = [
        Planner(kr5, probe, gauge, replace(plain, pool=pool)).program(placements, [1, 2]).expected
        for pool in (1, 4)
    ]
    assert expected[1].after < expected[0].after < expected[0].before
    assert expected[1].before == expected[0].before


def test_rows_are_whitened(information, kr5):
    q = frozen(np.zeros((1, 6)))
    rows = information.rows(q, np.zeros((1, 3)))
    assert rows.shape == (1, 3, len(information.table.free) + 3)
    assert np.allclose(rows[0, :, -3:], -np.eye(3) / information.settings.noise)
