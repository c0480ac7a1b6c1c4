# SPDX-License-Identifier: Apache-2.0
"""Results do not depend on the order of poses, the locations' numbers, or where the base is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from simulated_calibration import active, kr5, passive, simulate

from calib_model.measurement import ProbingSet
from calib_solver.fitting import Options
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)
seldom = settings(max_examples=8, derandomize=True)
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope='module')
def noisy():
    """Ragged on purpose: spheres of 1 to 9 poses."""
    measured = simulate(kr5(), passive(), 51, locations=4, poses=9, noise=1e-4).measured
    keep = np.random.default_rng(1).uniform(size=len(measured.poses)) < 0.8
    return replace(measured, poses=measured.poses.take(keep))


@pytest.fixture(scope='module')
def answer(noisy):
    return identify(noisy)


def with_poses(measured, **columns):
    return replace(measured, poses=replace(measured.poses, **columns))


def same(done, answer):
    """As near as rounding lets two ways through the same sums come."""
    assert done.fit.converged
    assert answer.fit.converged
    assert done.identified.phi == pytest.approx(answer.identified.phi, rel=1e-9)
    np.testing.assert_allclose(done.full, answer.full, atol=1e-9)


@seldom
@given(seed=seeds)
def test_the_order_of_the_poses_is_nothing(noisy, answer, seed):
    order = np.random.default_rng(seed).permutation(len(noisy.poses))
    same(identify(replace(noisy, poses=noisy.poses.take(order))), answer)


@pytest.mark.slow
@pytest.mark.parametrize('objective', ['distance_repeatability', 'distance', 'position'])
def test_the_order_is_nothing_to_any_objective_nor_to_an_active_probe(objective):
    measured = simulate(kr5(), active(), 52, locations=4, poses=9, noise=1e-4).measured
    order = np.random.default_rng(3).permutation(len(measured.poses))
    shuffled = replace(measured, poses=measured.poses.take(order))
    options = Options(objective)
    done, answer = identify(shuffled, options), identify(measured, options)
    assert done.fit.converged == answer.fit.converged
    assert done.identified.phi == pytest.approx(answer.identified.phi, rel=1e-6)
    np.testing.assert_allclose(done.full, answer.full, atol=1e-7)


@seldom
@given(numbers=st.lists(st.integers(1, 65535), min_size=4, max_size=4, unique=True))
def test_the_numbers_of_the_locations_are_nothing(noisy, answer, numbers):
    renumbered = np.array([0, *numbers])[noisy.poses.location]
    done = identify(with_poses(noisy, location=renumbered))
    same(done, answer)
    assert set(done.problem.keys[:, 0]) == set(numbers)


@seldom
@given(height=st.floats(-3, 3), turn=st.floats(-3, 3))
def test_lifting_and_turning_the_base_about_the_first_axis_is_nothing(noisy, answer, height, turn):
    """d1 and theta_0_1 move the base: every other parameter stays what it was."""
    first = noisy.arm.joints[0]
    joints = (replace(first, d=first.d + height, theta_0=first.theta_0 + turn),)
    arm = replace(noisy.arm, joints=joints + noisy.arm.joints[1:])
    done = identify(replace(noisy, arm=arm))
    assert done.fit.converged
    assert done.identified.phi == pytest.approx(answer.identified.phi, rel=1e-6)
    offsets = [run.full - run.table.nominal for run in (done, answer)]
    np.testing.assert_allclose(*offsets, atol=1e-8)


@seldom
@given(turn=st.floats(-3, 3))
def test_an_encoder_zero_moved_with_its_theta_0_is_nothing(noisy, answer, turn):
    """Joint readings that count from elsewhere, said so in the description."""
    joints = noisy.poses.joints.copy()
    joints[:, 2] += turn
    rows = list(noisy.arm.joints)
    rows[2] = replace(rows[2], theta_0=rows[2].theta_0 + turn)
    moved = with_poses(replace(noisy, arm=replace(noisy.arm, joints=tuple(rows))), joints=joints)
    done = identify(moved)
    offsets = [run.full - run.table.nominal for run in (done, answer)]
    np.testing.assert_allclose(*offsets, atol=1e-8)


@seldom
@given(turns=st.lists(st.integers(-2, 2), min_size=6, max_size=6))
def test_whole_turns_of_the_joints_are_nothing(noisy, answer, turns):
    joints = noisy.poses.joints + 2 * np.pi * np.array(turns)
    same(identify(with_poses(noisy, joints=joints)), answer)


@seldom
@given(flips=st.lists(st.sampled_from([1, -1]), min_size=6, max_size=6))
def test_a_joint_that_counts_the_other_way_is_nothing(noisy, answer, flips):
    rows = [replace(j, direction=f) for j, f in zip(noisy.arm.joints, flips, strict=True)]
    arm = replace(noisy.arm, joints=tuple(rows))
    done = identify(with_poses(replace(noisy, arm=arm), joints=noisy.poses.joints * flips))
    same(done, answer)


@seldom
@given(seed=seeds)
def test_the_names_of_the_joints_stamps_and_counts_are_nothing(noisy, answer, seed):
    generator = np.random.default_rng(seed)
    names = [f'axis_{k}' for k in generator.permutation(6)]
    joints = [replace(j, name=n) for j, n in zip(noisy.arm.joints, names, strict=True)]
    poses = noisy.poses
    count = len(poses)
    stamped = replace(
        poses, stamp=generator.permutation(count), readings=generator.integers(1, 9, count)
    )
    renamed = replace(noisy, arm=replace(noisy.arm, joints=tuple(joints)), poses=stamped)
    same(identify(renamed), answer)


@pytest.mark.parametrize('objective', ['distance_repeatability', 'distance', 'position'])
def test_the_same_poses_give_the_same_numbers_bit_for_bit(noisy, objective):
    first, second = (identify(noisy, Options(objective)) for _ in range(2))
    assert first.full.tolist() == second.full.tolist()
    assert first.identified.phi == second.identified.phi


def test_poses_that_come_in_parts_are_one_set(noisy, answer):
    halves = [noisy.poses.take(np.arange(i, len(noisy.poses), 2)) for i in (0, 1)]
    same(identify(replace(noisy, poses=ProbingSet.joined(halves))), answer)
