# SPDX-License-Identifier: Apache-2.0
"""Quantities of standards are what their definitions say, on points that can be counted by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st
from simulated_calibration import kr5, passive, simulate

from calib_solver.problem import Problem
from calib_solver.quality import assess, lengths, standard_figures
from calib_solver.quality.standards import enclosing_radii
from calib_solver.results import quality_record

SEEDS = st.integers(0, 10**6)


def enclosing_radius(points):
    return enclosing_radii(points, np.array([len(points)]))[0]


@pytest.mark.slow
@given(SEEDS, st.integers(1, 60))
def test_no_point_is_outside_the_smallest_sphere_and_it_is_the_smallest(seed, count):
    generator = np.random.default_rng(seed)
    points = generator.normal(size=(count, 3)) * generator.uniform(0, 1, 3)
    radius = enclosing_radius(points)
    # a sphere about any place needs at least that radius, and pushing a guess shrinks to it
    guess, step = points.mean(axis=0), np.ptp(points, axis=0).max(initial=0.0)
    for k in range(1, 400):
        away = np.linalg.norm(points - guess, axis=1)
        assert away.max() >= radius * (1 - 1e-9)
        guess = guess + (points[np.argmax(away)] - guess) / (k + 1)
    assert np.linalg.norm(points - guess, axis=1).max() <= radius + 0.02 * step + 1e-12


def test_spheres_of_known_size_are_found():
    square = np.array([[1.0, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0], [0.2, 0.1, 0]])
    assert enclosing_radius(square) == pytest.approx(np.sqrt(2))
    assert enclosing_radius(square[:1]) == 0
    assert enclosing_radius(np.zeros((7, 3))) == 0
    obtuse = np.array([[-3.0, 0, 0], [3, 0, 0], [0, 0.5, 0]])
    assert enclosing_radius(obtuse) == pytest.approx(3)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    assert enclosing_radius(corners) == pytest.approx(np.sqrt(3) / 2)


@pytest.mark.slow
@given(SEEDS, st.lists(st.integers(1, 30), min_size=1, max_size=6))
def test_many_spheres_at_once_are_those_found_one_by_one(seed, counts):
    points = np.random.default_rng(seed).normal(size=(sum(counts), 3))
    runs = np.split(points, np.cumsum(counts)[:-1])
    together = enclosing_radii(points, np.array(counts))
    assert together == pytest.approx([enclosing_radius(run) for run in runs], rel=1e-12)


@pytest.fixture(scope='module')
def quality():
    measured = simulate(kr5(), passive(), 8, locations=2, poses=6, noise=1e-4).measured
    return assess(Problem.of(measured), measured.arm, measured.probe)


def test_pose_and_distance_quantities_are_those_of_iso_9283(quality):
    found = standard_figures(quality)
    for row in range(len(quality.spheres.poses)):
        own = quality.deviation[6 * row : 6 * row + 6]
        away = np.linalg.norm(own, axis=1)
        spread = np.sqrt(((away - away.mean()) ** 2).sum() / 5)
        assert found.repeatability[row] == pytest.approx(away.mean() + 3 * spread)
    single = lengths(quality)
    for pair in range(len(quality.pairs)):
        own = single.deviation[single.pair == pair]
        assert found.distance_accuracy[pair] == pytest.approx(own.mean())
        assert found.distance_repeatability[pair] == pytest.approx(3 * own.std(ddof=1))


def test_the_location_error_lies_between_the_largest_distance_of_two_points_and_their_ball(quality):
    found = standard_figures(quality)
    for row, diameter in enumerate(found.location_error):
        own = quality.deviation[6 * row : 6 * row + 6]
        apart = np.linalg.norm(own[:, None] - own[None], axis=2).max()
        assert apart <= diameter * (1 + 1e-9)
        assert diameter <= 2 * np.linalg.norm(own, axis=1).max() * (1 + 1e-9)


def test_the_record_has_the_largest_and_claims_no_standard(quality):
    record, found = quality_record(quality)['standards'], standard_figures(quality)
    assert record['location_error'] == found.location_error.max()
    row = int(np.argmax(found.location_error))
    place = [record['location_error_location'], record['location_error_sphere']]
    assert place == quality.spheres.keys[row].tolist()
    assert record['pose_accuracy'] == quality.displaced.max()
    assert abs(record['length_error']) == np.abs(lengths(quality).deviation).max()
    assert 'not a test by them' in record['basis']


def test_what_too_few_poses_do_not_tell_is_null():
    measured = simulate(kr5(), passive(), 8, locations=1, poses=1, spheres=(3,)).measured
    quality = assess(Problem.of(measured), measured.arm, measured.probe)
    record = quality_record(quality)['standards']
    assert {value for name, value in record.items() if name != 'basis'} == {None}
