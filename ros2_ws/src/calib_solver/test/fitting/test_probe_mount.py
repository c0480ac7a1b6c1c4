# SPDX-License-Identifier: Apache-2.0
"""Eq. 15: P and the sphere's centre from readings that vary, a refusal from those that do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import GAUGE, active, iiwa, kr5, passive, simulate, turned_kr5

from calib_model.errors import RankError
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import (
    RigidTransform,
    nearest_rotation,
    rotation_matrix,
    rotation_vector,
)
from calib_solver.fitting.probe_mount import fit_probe, with_the_arms_share
from calib_solver.fitting.probe_mount_linear import linear_system, solve_linear
from calib_solver.problem import Problem
from calib_solver.quality import assess

pytestmark = pytest.mark.timeout(60)


def known_arm(arm, seed, spheres=(6,), poses=15, noise=0.0):
    """Poses of an arm that is exactly as described; only the probe's mount is not."""
    scene = simulate(arm, active(), seed, locations=1, spheres=spheres, poses=poses, noise=noise)
    return replace(scene, measured=replace(scene.measured, arm=scene.true))


def center_of(scene):
    """Where the sphere of the first pose stands in the base frame, by the truth."""
    measured = scene.measured
    T_base_flange = forward_kinematics(scene.true, measured.poses.joints[:1])[0]
    center = measured.probe.centers(measured.poses.displacement[:1], GAUGE.sphere_diameter)[0]
    return RigidTransform.from_matrix(T_base_flange).apply(scene.mount.apply(center))


@pytest.mark.parametrize('make', [kr5, turned_kr5, iiwa])
@pytest.mark.parametrize('seed', range(3))
def test_noise_free_readings_of_one_sphere_give_P_and_the_centre(make, seed):
    scene = known_arm(make(), seed)
    fit = fit_probe(Problem.of(scene.measured))
    np.testing.assert_allclose(fit.flange_T_probe.matrix(), scene.mount.matrix(), atol=1e-9)
    fitted = scene.measured.probe.mounted(fit.flange_T_probe)
    spheres = assess(Problem.of(scene.measured), scene.measured.arm, fitted).spheres
    np.testing.assert_allclose(spheres.center[0], center_of(scene), atol=1e-9)
    assert (fit.spheres, fit.poses) == (1, 15)
    assert fit.residual_rms < 1e-12
    assert fit.orthogonality_error < 1e-7
    assert np.isfinite(fit.condition)
    assert fit.standard_uncertainty.shape == (6,)


def test_a_probe_mounted_the_other_way_round_is_found_all_the_same():
    scene = known_arm(kr5(), 4)
    half_turn = RigidTransform(np.array([0.2, -0.1, -0.3]), np.array([0.0, 3.0, 0.9]))
    measured = replace(scene.measured, probe=scene.measured.probe.mounted(half_turn))
    fit = fit_probe(Problem.of(measured))
    np.testing.assert_allclose(fit.flange_T_probe.matrix(), scene.mount.matrix(), atol=1e-9)


def test_several_spheres_of_several_locations_give_P_too():
    scene = simulate(kr5(), active(), 5, locations=3, poses=5)
    fit = fit_probe(Problem.of(replace(scene.measured, arm=scene.true)))
    np.testing.assert_allclose(fit.flange_T_probe.matrix(), scene.mount.matrix(), atol=1e-9)
    assert (fit.spheres, fit.poses) == (12, 60)


def test_the_refined_P_fits_noisy_readings_better_than_its_neighbours():
    scene = known_arm(kr5(), 6, poses=40, noise=1e-4)
    problem = Problem.of(scene.measured)
    fit = fit_probe(problem)

    def scatter(translation, rotation):
        frames = forward_kinematics(scene.measured.arm, problem.joints)
        p_flange = problem.centers @ rotation.T + translation
        p_base = np.einsum('nij,nj->ni', frames[:, :3, :3], p_flange) + frames[:, :3, 3]
        return ((p_base - p_base.mean(axis=0)) ** 2).sum()

    mount = fit.flange_T_probe
    best = scatter(mount.translation, mount.rotation)
    assert fit.residual_rms == pytest.approx(np.sqrt(best / (3 * 40)), rel=1e-9)
    for step in 1e-5 * np.eye(6):
        for sign in (1, -1):
            turned = rotation_matrix(sign * step[3:]) @ mount.rotation
            assert scatter(mount.translation + sign * step[:3], turned) > best


def test_the_stated_uncertainty_is_what_repeated_fits_scatter_by():
    """z-scores of 6 numbers over 20 sets: their rms is 1 within what 120 draws allow."""
    scores = []
    for seed in range(20):
        scene = known_arm(kr5(), 40 + seed, poses=60, noise=1e-4)
        fit = fit_probe(Problem.of(scene.measured))
        turn = fit.flange_T_probe.rotation @ scene.mount.rotation.T
        angle = (turn - turn.T)[[2, 0, 1], [1, 2, 0]]
        shift = fit.flange_T_probe.translation - scene.mount.translation
        scores.append(np.concatenate([shift, angle / 2]) / fit.standard_uncertainty)
    assert 0.7 < np.sqrt(np.mean(np.square(scores))) < 1.4


def written_out(frames, centers):
    """A and b of eqs. 16 and 17, number by number."""
    rows, right = [], []
    for T, (x, y, z) in zip(frames, centers, strict=True):
        for i in range(3):
            row = []
            for j in range(3):
                row += [T[i, j] * x, T[i, j] * y, T[i, j] * z, T[i, j]]
            rows.append(row + [-1.0 if i == k else 0.0 for k in range(3)])
            right.append(-T[i, 3])
    return np.array(rows), np.array(right)


def test_the_linear_system_is_eqs_16_and_17_written_out():
    scene = known_arm(kr5(), 7, poses=4)
    problem = Problem.of(scene.measured)
    frames = forward_kinematics(scene.measured.arm, problem.joints)
    matrix, right = linear_system(frames, problem.centers)
    expected = written_out(frames, problem.centers)
    np.testing.assert_array_equal(matrix, expected[0])
    np.testing.assert_array_equal(right, expected[1])


def test_the_true_P_and_centre_solve_the_linear_system():
    scene = known_arm(kr5(), 8)
    problem = Problem.of(scene.measured)
    matrix, right = linear_system(
        forward_kinematics(scene.measured.arm, problem.joints), problem.centers
    )
    q = np.concatenate([scene.mount.matrix()[:3].reshape(-1), center_of(scene)])
    np.testing.assert_allclose(matrix @ q, right, atol=1e-14)


def test_the_linear_solution_is_the_least_squares_one_of_eq_15():
    """With two spheres each has three unknowns of its own."""
    scene = known_arm(kr5(), 7, spheres=(1, 14), poses=30, noise=1e-5)
    problem = Problem.of(scene.measured)
    matrix, right = written_out(
        forward_kinematics(scene.measured.arm, problem.joints), problem.centers
    )
    both = np.zeros((len(matrix), 18))
    both[:, :12] = matrix[:, :12]
    both[:90, 12:15], both[90:, 15:] = matrix[:90, 12:], matrix[90:, 12:]
    q = np.linalg.lstsq(both, right, rcond=None)[0]
    found = solve_linear(problem)
    np.testing.assert_allclose(found.mount.reshape(-1), q[:12], rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(
        found.rotation, nearest_rotation(q[:12].reshape(3, 4)[:, :3]), atol=1e-6
    )


@pytest.mark.parametrize('seed', range(20))
def test_the_nearest_rotation_is_one_and_no_other_is_nearer(seed):
    generator = np.random.default_rng(seed)
    # both of positive and of negative determinant
    matrix = generator.normal(size=(3, 3))
    found = nearest_rotation(matrix)
    np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(found) == pytest.approx(1.0)
    nearest = np.linalg.norm(found - matrix)
    for turn in generator.normal(size=(50, 3)) * generator.choice([1e-3, 0.1, 2.0], (50, 1)):
        assert np.linalg.norm(rotation_matrix(turn) @ found - matrix) >= nearest - 1e-12


def constant_readings(scene):
    """Every pose with the sphere at the same place in the probe, joints as they are."""
    same = np.tile(scene.measured.poses.displacement[:1], (len(scene.measured.poses), 1))
    return replace(scene.measured, poses=replace(scene.measured.poses, displacement=same))


def test_readings_that_do_not_vary_lack_rank_and_say_so():
    measured = constant_readings(known_arm(kr5(), 9, poses=30))
    with pytest.raises(RankError, match=r'simulated: eq\. 15 lacks rank.*vary'):
        fit_probe(Problem.of(measured))


def test_readings_that_vary_by_less_than_their_noise_lack_rank_and_say_so():
    scene = known_arm(kr5(), 10, poses=30, noise=1e-3)
    measured = constant_readings(scene)
    jitter = 1e-8 * np.random.default_rng(0).normal(size=(30, 3))
    poses = replace(measured.poses, displacement=measured.poses.displacement + jitter)
    with pytest.raises(RankError, match='rotation of P undetermined'):
        fit_probe(Problem.of(replace(measured, poses=poses)))


def test_a_passive_probe_lacks_rank_and_is_named():
    scene = simulate(kr5(), passive(), 1, locations=1, spheres=(6,), poses=20)
    with pytest.raises(RankError, match='seat is passive'):
        fit_probe(Problem.of(scene.measured))


@pytest.mark.parametrize('poses', [1, 2, 4])
def test_too_few_poses_are_counted_out(poses):
    scene = known_arm(kr5(), 11, poses=poses)
    with pytest.raises(RankError, match=rf'lacks rank: {poses} poses .* {3 * poses - 3} equations'):
        fit_probe(Problem.of(scene.measured))


def test_five_poses_are_just_enough():
    scene = known_arm(kr5(), 12, poses=5)
    fit = fit_probe(Problem.of(scene.measured))
    np.testing.assert_allclose(fit.flange_T_probe.matrix(), scene.mount.matrix(), atol=1e-9)


def test_a_single_posture_lacks_rank_however_often_it_is_taken():
    scene = known_arm(kr5(), 13, poses=30)
    poses = scene.measured.poses
    frozen = replace(poses, joints=np.tile(poses.joints[:1], (30, 1)))
    with pytest.raises(RankError, match='postures do not vary enough'):
        fit_probe(Problem.of(replace(scene.measured, poses=frozen)))


def test_turning_the_last_joint_alone_lacks_rank():
    """All flange frames share an axis: where the probe sits along it nothing tells."""
    scene = known_arm(kr5(), 14, poses=30)
    joints = np.tile(scene.measured.poses.joints[:1], (30, 1))
    joints[:, 5] = np.linspace(-2, 2, 30)
    poses = replace(scene.measured.poses, joints=joints)
    with pytest.raises(RankError, match='lacks rank'):
        fit_probe(Problem.of(replace(scene.measured, poses=poses)))


@pytest.mark.slow
@pytest.mark.parametrize(('errors', 'noise'), [(1.0, 1e-5), (0.02, 5e-5)])
def test_an_arm_that_is_not_calibrated_is_counted_in(errors, noise):
    """The residuals come of few parameters of the arm: 600 poses average nothing out."""
    scores, alone = [], []
    for seed in range(20):
        scene = simulate(kr5(), active(), 2000 + seed, 5, poses=30, noise=noise, errors=errors)
        problem = Problem.of(scene.measured)
        fit = fit_probe(problem)
        counted = with_the_arms_share(problem, fit)
        turned = fit.flange_T_probe.rotation @ scene.mount.rotation.T
        off = np.concatenate(
            [
                fit.flange_T_probe.translation - scene.mount.translation,
                rotation_vector(turned),
            ]
        )
        scores.append(off / counted.standard_uncertainty)
        alone.append(off[[0, 2]] / fit.standard_uncertainty[[0, 2]])
    rms = np.sqrt(np.mean(np.square(scores), axis=0))
    assert np.all((rms > 0.3) & (rms < 2.2)), rms
    assert np.sqrt(np.mean(np.square(alone))) > 5
