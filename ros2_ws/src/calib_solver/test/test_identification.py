# SPDX-License-Identifier: Apache-2.0
"""Noise-free poses of an arm within the D-H model are explained to the last digit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import (
    active,
    iiwa,
    kr5,
    passive,
    perturbed,
    random_arm,
    scara_like,
    simulate,
    turned_kr5,
    ur_like,
)

from calib_model.errors import DataError, RankError
from calib_model.kinematics import DEFAULT_SIGMA, points
from calib_solver.fitting import NO_PRIOR, Options, Prior
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)

ARMS = {
    'kr5': kr5,
    'kr5, axes 2 and 3 0.01 deg from parallel': lambda: kr5(np.radians(0.01)),
    'kr5, joints counting the other way': turned_kr5,
    'iiwa': iiwa,
    'first two axes parallel': scara_like,
    'three axes parallel': ur_like,
}
PROBES = {'active': active, 'passive': passive}


def refuse_anything_short_of_exact(scene, done):
    assert done.fit.converged, done.fit.reason
    assert done.identified.phi < 1e-20
    assert scene.prediction_error(scene.measured.arm, scene.measured.probe) > 1e-4
    assert scene.prediction_error(done.arm, done.probe) < 1e-9
    assert done.observability.rank == len(done.fit.x)
    assert not any(done.observability.reason)


@pytest.mark.slow
@pytest.mark.parametrize('probe', PROBES)
@pytest.mark.parametrize('arm', ARMS)
def test_noise_free_poses_give_the_true_predictions(arm, probe):
    scene = simulate(ARMS[arm](), PROBES[probe](), 21, poses=14)
    refuse_anything_short_of_exact(scene, identify(scene.measured))


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(10))
def test_random_arms_are_recovered(seed):
    arm = random_arm(np.random.default_rng(1000 + seed))
    probe = active() if seed % 2 else passive()
    scene = simulate(arm, probe, seed, locations=4, poses=14)
    refuse_anything_short_of_exact(scene, identify(scene.measured))


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4))
def test_errors_of_2_mm_and_half_a_degree_are_recovered(seed):
    scene = simulate(kr5(), active(), 300 + seed, poses=14, errors=4.0)
    refuse_anything_short_of_exact(scene, identify(scene.measured))


@pytest.mark.slow
@pytest.mark.parametrize('objective', ['distance_repeatability', 'position'])
@pytest.mark.parametrize('probe', PROBES)
def test_each_objective_recovers_the_arm_without_a_prior_too(objective, probe):
    scene = simulate(kr5(), PROBES[probe](), 22, poses=14)
    done = identify(scene.measured, Options(objective, prior=NO_PRIOR))
    refuse_anything_short_of_exact(scene, done)


@pytest.mark.slow
@pytest.mark.parametrize('strength', [0.0, 1.0, 10.0])
def test_many_distances_alone_recover_the_arm(strength):
    scene = simulate(kr5(), passive(), 23, spheres=tuple(range(1, 15, 2)), poses=5)
    prior = Prior(DEFAULT_SIGMA, strength)
    done = identify(scene.measured, Options('distance', prior=prior))
    refuse_anything_short_of_exact(scene, done)


def test_distances_too_few_for_the_parameters_never_end_wrong_and_converged():
    """30 distances, 21 parameters, no noise: the truth, or a word that it could not be told."""
    scene = simulate(kr5(), passive(), 3, poses=8)
    done = identify(scene.measured, Options('distance'))
    right = scene.prediction_error(done.arm, done.probe) < 1e-8
    assert right or not done.fit.converged or any(done.observability.reason)


@pytest.mark.slow
def test_parallel_axes_let_no_parameter_run_off():
    for tilt in (0.0, np.radians(0.01)):
        scene = simulate(kr5(tilt), active(), 24, poses=14, noise=5e-5)
        done = identify(scene.measured)
        moved = np.abs(done.full - done.table.nominal)[: 5 * 6].reshape(5, 6)
        assert moved[[0, 2]].max() < 0.01  # m
        assert moved[[1, 3, 4]].max() < 0.02  # rad
        assert scene.prediction_error(done.arm, done.probe) < 1e-3


def test_the_arm_that_is_measured_already_is_left_as_it_is():
    scene = simulate(kr5(), active(), 25, poses=14)
    measured = replace(
        scene.measured, arm=scene.true, probe=scene.measured.probe.mounted(scene.mount)
    )
    done = identify(measured)
    assert done.fit.converged
    assert done.identified.phi < 1e-20
    truth = points(scene.true, measured.poses.joints, scene.mount.translation)
    found = points(done.arm, measured.poses.joints, done.probe.flange_T_probe.translation)
    np.testing.assert_allclose(found, truth, atol=1e-9)


def test_noise_is_averaged_out_not_fitted(active_scene):
    done = identify(active_scene.measured)
    assert done.fit.converged
    before = active_scene.prediction_error(active_scene.measured.arm, active_scene.measured.probe)
    assert active_scene.prediction_error(done.arm, done.probe) < before / 10
    assert done.identified.phi < done.initial.phi / 100


def test_held_out_spheres_gain_as_much_as_those_identified_from(active_scene):
    measured = active_scene.measured
    held_out = measured.poses.location == 5
    done = identify(replace(measured, poses=measured.poses.take(~held_out)))
    before = active_scene.prediction_error(measured.arm, measured.probe)
    assert active_scene.prediction_error(done.arm, done.probe) < before / 10


def test_the_fit_accounts_for_itself(active_scene):
    done = identify(active_scene.measured)
    assert done.fit.phi_initial >= done.fit.quadratic.phi
    assert done.fit.quadratic.phi == pytest.approx(done.identified.phi, rel=1e-9)
    assert 1 <= done.fit.iterations < done.fit.evaluations + 2
    assert len(done.fit.x) == len(done.table.free)
    assert done.seconds > 0
    assert done.probe_fit is not None


def test_a_passive_probe_has_no_eq_15(passive_scene):
    assert identify(passive_scene.measured).probe_fit is None


def test_readings_that_do_not_vary_are_a_warning_and_the_arm_is_identified_all_the_same():
    scene = simulate(kr5(), passive(), 26, poses=14, noise=5e-5)
    # an active probe that always reads the same is as good as a seat
    center = scene.measured.probe.center
    probe = active()
    same = np.tile(probe.displacements(center[None, :], 0.022), (len(scene.measured.poses), 1))
    poses = replace(scene.measured.poses, displacement=same)
    done = identify(replace(scene.measured, probe=probe, poses=poses))
    assert done.probe_fit is None
    assert done.warnings == ()
    assert done.identified.phi < done.initial.phi / 100


def test_data_that_no_objective_has_a_term_for_are_refused(passive_scene):
    measured = passive_scene.measured
    one = replace(measured, poses=measured.poses.take(np.array([0])))
    for objective in ('distance_repeatability', 'distance'):
        with pytest.raises(DataError, match=f'{objective} has no terms'):
            identify(one, Options(objective))


def test_fewer_residuals_than_parameters_are_refused_without_a_prior(passive_scene):
    measured = passive_scene.measured
    few = replace(measured, poses=measured.poses.take(np.arange(4)))
    with pytest.raises(RankError, match='9 residuals cannot tell 21 parameters'):
        identify(few, Options(prior=NO_PRIOR))


def test_fewer_residuals_than_parameters_stay_near_nominal_with_a_prior(passive_scene):
    measured = passive_scene.measured
    few = replace(measured, poses=measured.poses.take(np.arange(4)))
    done = identify(few)
    sigmas = done.options.prior.sigmas(done.table)
    assert np.abs(done.fit.x / sigmas).max() < 5
    assert np.isfinite(done.full).all()


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(3))
def test_true_parameters_that_the_data_fix_are_found(seed):
    """Without errors in what is frozen, each single free parameter comes out true."""
    generator = np.random.default_rng(seed)
    arm = random_arm(generator)
    scene = simulate(arm, passive(), seed, poses=14)
    geometry = perturbed(arm, generator).geometry.copy()
    geometry[2, 0], geometry[3, 0] = scene.true.geometry[2, 0], scene.true.geometry[3, 0]
    geometry[:4, -1] = scene.true.geometry[:4, -1]
    done = identify(replace(scene.measured, arm=arm.with_geometry(geometry)))
    np.testing.assert_allclose(done.arm.geometry, scene.true.geometry, atol=1e-9)
    mount = done.probe.flange_T_probe.apply(done.probe.center)
    np.testing.assert_allclose(mount, scene.mount.apply(done.probe.center), atol=1e-9)
