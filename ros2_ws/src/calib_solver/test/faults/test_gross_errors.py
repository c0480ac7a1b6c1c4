# SPDX-License-Identifier: Apache-2.0
"""Gross errors are found, named and left out; good poses are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import GAUGE, active, kr5, passive, simulate

from calib_model.kinematics import point_derivatives
from calib_solver.fitting import Options
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def scene():
    """Five locations of four spheres, 30 poses of each; little noise in the joints."""
    return simulate(kr5(), active(), 81, locations=5, poses=30, noise=2e-5)


@pytest.fixture(scope='module')
def best(scene):
    """The error (m) of the arm identified from good poses only."""
    return error(scene, identify(scene.measured))


def error(scene, done):
    return scene.prediction_error(done.arm, done.probe)


def spoilt(scene, **columns):
    measured = scene.measured
    return replace(measured, poses=replace(measured.poses, **columns))


def shifted(scene, bad, shift):
    """Joints with which the poses `bad` would hold the sphere `shift` (B, 3) away, m."""
    q = scene.measured.poses.joints.copy()
    p_flange = scene.mount.apply(scene.measured.centers()[bad])
    target = point_derivatives(scene.true, q[bad], p_flange).p_base + shift
    for _ in range(40):
        now = point_derivatives(scene.true, q[bad], p_flange)
        transposed = np.swapaxes(now.joints, 1, 2)
        normal = now.joints @ transposed + 1e-6 * np.eye(3)
        step = transposed @ np.linalg.solve(normal, (target - now.p_base)[:, :, None])
        q[bad] += np.clip(step[:, :, 0], -0.1, 0.1)
    return q


def some(scene, seed, share=0.05):
    drawn = np.random.default_rng(seed).uniform(size=len(scene.measured.poses))
    return np.flatnonzero(drawn < share)


def rejected(done):
    return [one.pose - 1 for one in done.rejected]


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(6))
@pytest.mark.parametrize('probe', [active, passive])
def test_no_good_pose_is_lost(probe, seed):
    """Though joints' noise moves the probe more in some postures than in others."""
    measured = simulate(kr5(), probe(), 820 + seed, locations=3, poses=25, noise=1e-4).measured
    done = identify(measured)
    assert done.rejected == ()
    assert done.warnings == ()


@pytest.mark.parametrize('seed', range(904, 907))
def test_one_sphere_of_three_poses_among_pairs_does_not_say_what_is_usual(seed):
    scene = simulate(kr5(), active(), seed, locations=2, poses=3, noise=1e-5)
    rows = np.arange(len(scene.measured.poses))
    pairs = scene.measured.poses.take((rows % 3 < 2) | (rows < 3))
    assert identify(replace(scene.measured, poses=pairs), Options(quick=True)).rejected == ()


@pytest.mark.slow
def test_clean_poses_give_the_same_arm_with_and_without_looking_for_gross_errors(scene):
    plain = identify(scene.measured, Options(loss='plain'))
    np.testing.assert_allclose(identify(scene.measured).full, plain.full, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(3))
def test_slipped_contacts_are_left_out_with_their_sizes(scene, best, seed):
    bad = some(scene, seed)
    generator = np.random.default_rng(100 + seed)
    along = generator.normal(size=(len(bad), 3))
    size = generator.uniform(1e-3, 20e-3, len(bad))
    shift = along / np.linalg.norm(along, axis=1, keepdims=True) * size[:, None]
    done = identify(spoilt(scene, joints=shifted(scene, bad, shift)))
    assert rejected(done) == bad.tolist()
    np.testing.assert_allclose([one.size for one in done.rejected], size, atol=2e-4)
    poses = scene.measured.poses
    for one in done.rejected:
        key = poses.location[one.pose - 1], poses.sphere[one.pose - 1]
        assert (one.location, one.sphere) == key
        assert 'slipped' in one.reason
    assert f'{len(bad)} of {len(poses)} poses left out' in done.warnings[0]
    assert error(scene, done) < 1.2 * best
    plain = identify(spoilt(scene, joints=shifted(scene, bad, shift)), Options(loss='plain'))
    assert plain.rejected == ()
    assert error(scene, plain) > 5 * best


@pytest.mark.slow
def test_mislabelled_poses_are_named_with_the_sphere_they_are_at(scene, best):
    bad = some(scene, 7)
    sphere = scene.measured.poses.sphere.copy()
    true = sphere[bad]
    sphere[bad] = np.where(true == 1, 14, 1)
    done = identify(spoilt(scene, sphere=sphere))
    assert rejected(done) == bad.tolist()
    assert [one.reason for one in done.rejected] == [
        f'is at sphere {number}: mislabelled' for number in true
    ]
    assert error(scene, done) < 1.2 * best


@pytest.mark.slow
@pytest.mark.parametrize(('first', 'count'), [(35, 15), (50, 40), (100, 70)])
@pytest.mark.parametrize('stylus', [0, 2])
def test_a_stuck_stylus_is_called_stuck(scene, best, first, count, stylus):
    """For part of a sphere, across two, and for all of one."""
    displacement = scene.measured.poses.displacement.copy()
    displacement[first : first + count, stylus] = displacement[first, stylus]
    done = identify(spoilt(scene, displacement=displacement))
    assert rejected(done) == list(range(first, first + count))
    assert {one.reason for one in done.rejected} == {
        'a stylus reads the same from pose to pose: stuck'
    }
    # with 70 of 600 poses gone, and few left of one sphere
    assert error(scene, done) < 2 * best


def test_readings_that_repeat_and_fit_are_kept(scene):
    """A pose taken six times over, as a stationary arm gives it, is no stuck stylus."""
    poses = scene.measured.poses
    rows = np.arange(len(poses))
    again = poses.take(np.repeat(rows, np.where(rows == 40, 6, 1)))
    assert identify(replace(scene.measured, poses=again)).rejected == ()


@pytest.mark.slow
@pytest.mark.parametrize('wrong', [3, 7])
def test_a_sphere_mislabelled_throughout_is_set_apart_and_named(scene, best, wrong):
    poses = scene.measured.poses
    sphere = np.where((poses.location == 2) & (poses.sphere == 6), wrong, poses.sphere)
    done = identify(spoilt(scene, sphere=sphere))
    assert done.rejected == ()
    assert any(f'location 2: sphere {wrong} is not where' in text for text in done.warnings)
    assert len(done.problem.pairs) == 5 * 6 - 3
    assert error(scene, done) < 1.2 * best


@pytest.mark.slow
def test_a_gauge_pushed_between_two_spheres_no_longer_bends_the_arm(scene, best):
    poses = scene.measured.poses
    bad = np.flatnonzero((poses.location == 3) & np.isin(poses.sphere, (10, 14)))
    along = scene.true_centre(3, 14) - scene.true_centre(3, 1)
    push = 5e-4 * along / np.linalg.norm(along)
    joints = shifted(scene, bad, np.tile(push, (len(bad), 1)))
    done = identify(spoilt(scene, joints=joints))
    assert done.rejected == ()
    assert any('location 3' in text and 'gauge moved' in text for text in done.warnings)
    assert len(done.problem.pairs) == 5 * 6 - 4
    assert error(scene, done) < 1.3 * best
    assert error(scene, identify(spoilt(scene, joints=joints), Options(loss='plain'))) > 3 * best


@pytest.mark.slow
@pytest.mark.parametrize('objective', ['distance', 'position'])
def test_the_other_objectives_leave_out_the_same_poses(scene, objective):
    bad = some(scene, 9)
    shift = np.tile([2e-3, 0.0, 0.0], (len(bad), 1))
    measured = spoilt(scene, joints=shifted(scene, bad, shift))
    assert rejected(identify(measured, Options(objective))) == bad.tolist()


def test_a_gauge_of_another_size_is_no_gross_error(scene):
    """A wrong certificate as a whole shows everywhere alike: nothing stands out."""
    spheres = tuple((k, tuple(1.001 * np.array(c))) for k, c in GAUGE.spheres)
    gauge = replace(GAUGE, spheres=spheres)
    assert identify(replace(scene.measured, gauge=gauge)).rejected == ()
