# SPDX-License-Identifier: Apache-2.0
"""What makes points scatter, and what that makes of parameters, targets and stations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulated_calibration import kr5, on_a_rail
from simulated_points import Tracked, tracked

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_solver.acceptance.point_prediction import _Placed
from calib_solver.fitting import NO_PRIOR, Options
from calib_solver.points import Flange, PointIdentification, identify_points
from calib_solver.points.part_noise import part_factors
from calib_solver.points.place_shares import PlaceShares
from calib_solver.points.point_noise import moved_by_joints

NOISE = 4e-5
JOINTS = np.array([4e-4, 3e-4, 4e-4, 1e-4, 1e-4, 1e-4])
PLAIN = Options('position', prior=NO_PRIOR, loss='plain', joint_errors=(), quick=True)


def read_by(scene: Tracked, sigma: Array, seed: int) -> Tracked:
    """The scene with joints that scatter."""
    points = scene.measured.points
    off = sigma * np.random.default_rng(seed).normal(size=points.joints.shape)
    read = replace(points, joints=points.joints + off)
    return replace(scene, measured=replace(scene.measured, points=read))


@cache
def scattered(oriented: bool) -> PointIdentification:
    scene = tracked(44, 900, 2, 2, oriented, NOISE, 1e-4)
    return identify_points(read_by(scene, JOINTS, 3).measured, PLAIN)


@pytest.mark.parametrize('oriented', [False, True])
def test_the_joints_that_scatter_are_told_from_the_tracker(oriented: bool):
    found = scattered(oriented).noise
    np.testing.assert_allclose(np.sqrt(found.poses.joints[:3]), JOINTS[:3], rtol=0.15)
    assert np.sqrt(found.poses.joints[3:]).max() < 3e-4
    assert 0 <= found.poses.point < (2 * NOISE) ** 2
    assert found.poses.freedom < 0.7 * 3 * 900


def test_a_target_that_shakes_is_stated_so_and_makes_nothing_else_of_the_joints():
    scene = tracked(48, 500, 2, 2, True, NOISE, 1e-4)
    points, generator = scene.measured.points, np.random.default_rng(9)
    shaken = points.position + 8e-5 * generator.normal(size=points.position.shape) * (
        points.target == '2'
    ).reshape(-1, 1)
    measured = replace(scene.measured, points=replace(points, position=shaken))
    even, done = identify_points(scene.measured, PLAIN), identify_points(measured, PLAIN)
    noise, problem = done.noise, done.problem
    first = problem.parts[:-1]
    sigma = np.sqrt(noise.poses.point * noise.point_factors)
    expected = np.where(problem.target[first] == 1, np.hypot(NOISE, 8e-5), NOISE)
    np.testing.assert_allclose(sigma, expected, rtol=0.15)
    assert np.sqrt(noise.turn) == pytest.approx(1e-4, rel=0.1)
    assert np.sqrt(noise.poses.joints).max() < 6e-5
    more = [
        np.mean(after.translation_uncertainty / before.translation_uncertainty)
        for after, before in zip(done.targets, even.targets, strict=True)
    ]
    assert more[0] < 0.75 * more[1]


def test_parts_that_scatter_alike_are_not_told_apart():
    part, freedom = np.repeat(np.arange(12), 3 * 15), np.full(540, 0.8)
    size = np.random.default_rng(1).normal(size=540) ** 2
    assert (part_factors(part, 13, 1e-9 * size, freedom) == 1).all()
    seen = part_factors(part, 13, np.where(part == 4, 6.0, 1.0) * size, freedom)
    assert seen[4] == seen.max() > 2.5
    assert seen[part].mean() == pytest.approx(1)


def test_a_tracker_that_scatters_alike_is_found_to_do_so():
    done = identify_points(tracked(45, 300, noise=NOISE).measured, PLAIN)
    noise = done.noise.poses
    moved, _ = moved_by_joints(
        done.problem, done.table, done.full, done.places, np.arange(len(done.problem))
    )
    by_joints = np.einsum('nkj,j->nk', moved**2, noise.joints).mean()
    assert noise.point + by_joints == pytest.approx(NOISE**2, rel=0.15)
    assert by_joints < 0.3 * noise.point


@pytest.mark.parametrize('arm', [kr5(), on_a_rail()], ids=['revolute', 'rail and coupled axis'])
def test_points_move_with_the_readings_as_is_said(arm: Arm):
    done = identify_points(tracked(46, 60, 1, 1, True, NOISE, 1e-4, arm=arm).measured, PLAIN)
    problem, rows = done.problem, np.arange(0, 60, 5)
    moved, turned = moved_by_joints(problem, done.table, done.full, done.places, rows)
    for joint in range(arm.n):
        step = 1e-6 * (np.arange(arm.n) == joint)
        ends = [
            Flange.of(replace(problem, joints=problem.joints + side * step), done.table, done.full)
            for side in (1, -1)
        ]
        points = [end.points(problem, done.places)[rows] for end in ends]
        np.testing.assert_allclose((points[0] - points[1]) / 2e-6, moved[:, :, joint], atol=1e-8)
        turn = ends[0].rotation[rows] @ np.swapaxes(ends[1].rotation[rows], 1, 2)
        turn = (turn - np.swapaxes(turn, 1, 2)) / 2
        vector = np.stack([turn[:, 2, 1], turn[:, 0, 2], turn[:, 1, 0]], axis=1) / 2e-6
        np.testing.assert_allclose(vector, turned[:, :, joint], atol=1e-8)


def test_shares_of_places_add_up_to_the_covariance_of_all_columns():
    generator = np.random.default_rng(2)
    free, targets, stations = 5, ('1', '2'), (1, 4)
    known, size = free + 12, free + 24
    # each point has its own station's columns alone
    slopes = generator.normal(size=(300, size))
    slopes[:150, known + 6 :] = slopes[150:, known : known + 6] = 0.0
    scatter = generator.uniform(0.1, 3.0, 300)
    normal, gradient = slopes.T @ slopes, (slopes.T * scatter) @ slopes
    information = np.full(free, 20.0)
    shares = PlaceShares.of(normal, information, gradient, targets, stations, 0.0)
    held = normal + np.diag(np.r_[information, np.zeros(size - free)])
    inverse = np.linalg.inv(held)
    covariance = inverse @ gradient @ inverse
    np.testing.assert_allclose(shares.noise, covariance[:known, :known], rtol=1e-8, atol=1e-12)
    prior = (inverse @ normal - np.eye(size))[:, :free]
    np.testing.assert_allclose(shares.prior, prior[:known], rtol=1e-8, atol=1e-12)
    for place, one in enumerate(shares.stations):
        at = slice(known + 6 * place, known + 6 * place + 6)
        cross = shares.noise @ one.along.T + one.common
        np.testing.assert_allclose(cross, covariance[:known, at], rtol=1e-8, atol=1e-12)
        own = one.along @ cross + (one.own + one.common.T @ one.along.T)
        np.testing.assert_allclose(own, covariance[at, at], rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize('columns', [0, 6])
def test_moments_of_placed_points_are_those_of_the_whole_matrix(columns: int):
    generator = np.random.default_rng(5)
    placing = generator.normal(size=(9, 3, columns))
    root = generator.normal(size=(9, 3, 3))
    scatter, weight = root @ np.swapaxes(root, 1, 2), generator.uniform(0.5, 2.0, 9)
    placed = _Placed.of(placing, weight, scatter)
    whole = np.zeros((27, 27))
    for i, block in enumerate(scatter):
        whole[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = block
    motion, weights = placing.reshape(27, columns), np.repeat(weight, 3)
    left = np.eye(27) - motion @ np.linalg.pinv(motion * np.sqrt(weights)[:, None]) * np.sqrt(
        weights
    )
    covariance = left @ whole @ left.T
    assert placed.mean == pytest.approx(np.trace(covariance))
    assert placed.square == pytest.approx((covariance**2).sum())
    errors = generator.normal(size=(9, 3, 4))
    after = placed.left(errors)
    np.testing.assert_allclose(after.reshape(27, 4), left @ errors.reshape(27, 4), atol=1e-12)
    flat = after.reshape(27, 4)
    assert placed.crossed(after) == pytest.approx(np.trace(flat.T @ covariance @ flat))
