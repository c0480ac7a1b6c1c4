# SPDX-License-Identifier: Apache-2.0
"""Eqs. 10, 11 and 13: their values as the chapter writes them, their gradients as they change."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import least_squares
from simulated_calibration import SPHERES, active, iiwa, kr5, passive, simulate

from calib_model.errors import DataError
from calib_model.instruments import Gauge
from calib_model.kinematics import identifiable_table
from calib_model.transforms import RigidTransform
from calib_solver.commands import identify
from calib_solver.fitting.objectives import OBJECTIVES, objective
from calib_solver.problem import Problem, accumulate
from calib_solver.quality import assess, probed_points

pytestmark = pytest.mark.timeout(60)


def chapters_terms(measured):
    """The terms of eq. 11 one by one, as the chapter counts them: before they are squared."""
    problem = Problem.of(measured)
    p_base = probed_points(problem, measured.arm, measured.probe)
    poses = measured.poses
    # from the measurement itself: nothing of the problem's sorting is trusted
    back = np.empty_like(p_base)
    back[problem.order] = p_base
    terms = []
    for location in np.unique(poses.location):
        means = {}
        for sphere in np.unique(poses.sphere[poses.location == location]):
            own = back[(poses.location == location) & (poses.sphere == sphere)]
            means[sphere] = own.mean(axis=0)
            if len(own) > 1:
                terms += list(2 * own.std(axis=0, ddof=1))
        for j, k in combinations(means, 2):
            certified = measured.gauge.distance(int(j), int(k))
            terms.append(float(np.linalg.norm(means[j] - means[k])) - certified)
    return np.array(terms)


def quadratic_at(problem, table, free, name):
    return objective(name)(problem, accumulate(problem, table, table.full(free)))


def table_of(measured):
    return identifiable_table(measured.arm, measured.probe)


def test_phi_of_eq_11_has_126_terms_for_7_locations_of_4_spheres():
    measured = simulate(kr5(), passive(), 4, locations=7, poses=5, noise=1e-4).measured
    terms = chapters_terms(measured)
    assert len(terms) == 126
    problem = Problem.of(measured)
    quality = assess(problem, measured.arm, measured.probe)
    assert len(quality.distance) == 42
    assert np.isfinite(quality.spheres.two_sigma).sum() == 84
    assert quality.phi == pytest.approx(terms @ terms, rel=1e-12)
    table = table_of(measured)
    quadratic = quadratic_at(
        problem, table, table.nominal[table.free_columns], 'distance_repeatability'
    )
    assert quadratic.phi == pytest.approx(terms @ terms, rel=1e-12)


def test_a_sphere_with_one_pose_and_a_location_with_one_sphere_count_as_eq_11_can(passive_scene):
    measured = ragged(passive_scene.measured)
    terms = chapters_terms(measured)
    quality = assess(Problem.of(measured), measured.arm, measured.probe)
    assert quality.phi == pytest.approx(terms @ terms, rel=1e-12)
    table = table_of(measured)
    for name in OBJECTIVES:
        quadratic = quadratic_at(
            Problem.of(measured), table, table.nominal[table.free_columns], name
        )
        assert np.isfinite(quadratic.phi)
        assert np.isfinite(quadratic.gradient).all()
        assert np.isfinite(quadratic.normal).all()


def ragged(measured):
    """Sphere 1 of location 1 with a single pose, location 2 with a single sphere."""
    poses = measured.poses
    single = (poses.location == 1) & (poses.sphere == 1)
    drop = single & (np.cumsum(single) > 1) | (poses.location == 2) & (poses.sphere != 6)
    return replace(measured, poses=poses.take(~drop))


@pytest.mark.slow
@pytest.mark.parametrize('name', OBJECTIVES)
@pytest.mark.parametrize('make', [kr5, iiwa])
@pytest.mark.parametrize('probe', [active, passive])
def test_the_gradient_is_half_the_finite_difference_of_phi(name, make, probe):
    measured = simulate(make(), probe(), 7, locations=3, poses=5, noise=1e-4).measured
    problem, table = Problem.of(measured), table_of(measured)
    generator = np.random.default_rng(1)
    at = table.nominal[table.free_columns]
    at = at + 1e-3 * generator.normal(size=len(at))
    quadratic = quadratic_at(problem, table, at, name)
    step = 1e-5
    for i, parameter in enumerate(table.free):
        moved = np.zeros(len(at))
        moved[i] = step

        def phi(count, moved=moved):
            return quadratic_at(problem, table, at + count * moved, name).phi

        slope = (8 * (phi(1) - phi(-1)) - (phi(2) - phi(-2))) / (12 * step)
        scale = np.sqrt(quadratic.phi * quadratic.normal[i, i])
        assert quadratic.gradient[i] == pytest.approx(slope / 2, abs=1e-6 * scale), parameter.name


@pytest.mark.parametrize('name', OBJECTIVES)
def test_the_normal_matrix_is_symmetric_and_positive(name, active_scene):
    problem, table = Problem.of(active_scene.measured), table_of(active_scene.measured)
    normal = quadratic_at(problem, table, table.nominal[table.free_columns], name).normal
    np.testing.assert_allclose(normal, normal.T, rtol=1e-9, atol=1e-12 * np.abs(normal).max())
    values = np.linalg.eigvalsh(normal)
    assert values[0] >= -1e-12 * values[-1]


@pytest.mark.slow
def test_position_is_eq_10_at_the_best_placement_of_each_location():
    measured = simulate(kr5(), active(), 4, locations=2, poses=5, noise=1e-4).measured
    problem, table = Problem.of(measured), table_of(measured)
    p_base = probed_points(problem, measured.arm, measured.probe)
    keys = np.repeat(problem.keys, problem.counts, axis=0)
    certified = np.array([measured.gauge.center(int(k)) for k in keys[:, 1]])
    total = 0.0
    for rows in problem.locations:
        own = keys[:, 0] == problem.keys[rows[0], 0]
        total += _smallest_sum_of_squares(certified[own], p_base[own])
    quadratic = quadratic_at(problem, table, table.nominal[table.free_columns], 'position')
    assert quadratic.phi == pytest.approx(total, rel=1e-9)
    quality = assess(problem, measured.arm, measured.probe)
    assert (quality.position**2).sum() == pytest.approx(total, rel=1e-9)


def _smallest_sum_of_squares(certified, measured):
    """Over all placements of the bar; its roll, which little shows, is started from four sides."""

    def residuals(x):
        return (RigidTransform(x[:3], x[3:]).apply(certified) - measured).reshape(-1)

    ends = certified[np.argmax(certified[:, 0])] - certified[np.argmin(certified[:, 0])]
    costs = []
    for roll in np.arange(4) * np.pi / 2:
        first = RigidTransform(np.zeros(3), roll * ends / np.linalg.norm(ends))
        placed = _roughly_placed(first.apply(certified), measured)
        rotation = RigidTransform(placed[:3], placed[3:]).matrix() @ first.matrix()
        start = RigidTransform.from_matrix(rotation)
        start = np.concatenate([start.translation, start.rotation_vector])
        costs.append(
            least_squares(
                residuals, start, jac='3-point', x_scale='jac', xtol=1e-15, ftol=1e-15, gtol=1e-15
            ).cost
        )
    return 2 * min(costs)


def _roughly_placed(certified, measured):
    """A placement near enough for a local search, from the two ends of the bar."""
    along = measured[np.argmax(certified[:, 0])] - measured[np.argmin(certified[:, 0])]
    along = along / np.linalg.norm(along)
    axis = np.cross([1.0, 0.0, 0.0], along)
    angle = np.arctan2(np.linalg.norm(axis), along[0])
    turn = RigidTransform(np.zeros(3), axis / np.linalg.norm(axis) * angle)
    offset = measured.mean(axis=0) - turn.apply(certified).mean(axis=0)
    return np.concatenate([offset, turn.rotation_vector])


@pytest.mark.parametrize('turn', [[0.0, 0.0, 0.0], [0.3, -2.0, 1.1], [0.0, np.pi, 0.0]])
def test_position_does_not_depend_on_the_frame_of_the_certificate(active_scene, turn):
    measured = active_scene.measured
    moved = RigidTransform(np.array([3.0, -1.0, 0.5]), np.array(turn))
    spheres = tuple(
        (k, tuple(moved.apply(measured.gauge.center(k)).tolist())) for k in measured.gauge.numbers
    )
    gauge = Gauge('moved', measured.gauge.sphere_diameter, spheres)
    elsewhere = replace(measured, gauge=gauge)
    table = table_of(measured)
    free = table.nominal[table.free_columns]
    for name in OBJECTIVES:
        here = quadratic_at(Problem.of(measured), table, free, name)
        there = quadratic_at(Problem.of(elsewhere), table, free, name)
        assert there.phi == pytest.approx(here.phi, rel=1e-9)
        scale = np.sqrt(here.phi * np.diag(here.normal))
        np.testing.assert_array_less(np.abs(there.gradient - here.gradient), 1e-9 * scale + 1e-18)


def test_an_unknown_objective_is_refused_with_the_list_of_those_there_are():
    with pytest.raises(DataError, match='distance_repeatability, distance, position'):
        objective('eq_11')


def test_pairs_are_every_two_spheres_of_a_location_once(passive_scene):
    problem = Problem.of(passive_scene.measured)
    named = [
        (int(problem.keys[i, 0]), int(problem.keys[i, 1]), int(problem.keys[j, 1]))
        for i, j in problem.pairs
    ]
    expected = [(loc, *pair) for loc in range(1, 6) for pair in combinations(SPHERES, 2)]
    assert named == expected


def test_the_command_offers_the_objectives_that_there_are():
    assert set(identify.OBJECTIVES) == set(OBJECTIVES)
