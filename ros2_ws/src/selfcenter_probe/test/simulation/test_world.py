# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_model.errors import ContactError
from calib_model.instruments import JOINT_PARAMETERS
from calib_model.kinematics import points
from calib_model.transforms import RigidTransform, rotation_vector
from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation.magnitudes import GaugeMagnitudes, Magnitudes
from selfcenter_probe.simulation.readings import probe_postures
from selfcenter_probe.simulation.world import bounded_normal, moved, true_centers


def same(first, second):
    return (
        np.array_equal(first.arm.geometry, second.arm.geometry)
        and np.array_equal(
            first.probe.flange_T_probe.matrix(), second.probe.flange_T_probe.matrix()
        )
        and np.array_equal(first.p_base_sphere, second.p_base_sphere)
        and np.array_equal(first.psds.amplitude, second.psds.amplitude)
    )


def test_the_world_of_the_descriptions_shows_each_sphere_where_it_should_be(scene):
    seen = scene.world(Magnitudes()).sight(scene.joints)
    np.testing.assert_array_equal(seen.location, scene.location)
    np.testing.assert_array_equal(seen.sphere, scene.sphere)
    np.testing.assert_allclose(seen.p_probe_sphere, scene.p_probe_sphere, atol=1e-12)


def test_the_seed_makes_the_world(scene, magnitudes):
    assert same(scene.world(magnitudes, 5), scene.world(magnitudes, 5))
    first, second = scene.world(magnitudes, 5), scene.world(magnitudes, 6)
    for row in range(4):
        assert (first.arm.geometry[row] != second.arm.geometry[row]).all()
    assert (first.p_base_sphere != second.p_base_sphere).all()
    assert (first.psds.amplitude != second.psds.amplitude).all()
    assert not np.array_equal(
        first.probe.flange_T_probe.matrix(), second.probe.flange_T_probe.matrix()
    )


def test_every_dh_parameter_is_off_by_its_own_magnitude(scene, magnitudes):
    errors = np.array(
        [scene.world(magnitudes, seed).arm.geometry - scene.arm.geometry for seed in range(200)]
    )
    sigma = {'a': 3e-4, 'd': 3e-4, 'alpha': 5e-4, 'theta_0': 5e-4}
    for row, key in enumerate(JOINT_PARAMETERS):
        if key == 'beta':
            assert not errors[:, row].any()
            continue
        assert (errors[:, row] != 0).all()
        # a normal distribution cut off at two sigma is 0.88 as wide
        np.testing.assert_allclose(errors[:, row].std(axis=0), 0.88 * sigma[key], rtol=0.2)
        assert np.abs(errors[:, row]).max() <= magnitudes.bound * sigma[key] + 1e-15


def test_each_part_of_the_world_draws_for_itself(scene, magnitudes):
    usual = scene.world(magnitudes)
    other_psd = scene.world(replace(magnitudes, psd=replace(magnitudes.psd, linearity_error=0)))
    assert np.array_equal(usual.arm.geometry, other_psd.arm.geometry)
    assert np.array_equal(usual.p_base_sphere, other_psd.p_base_sphere)
    more = replace(scene, placements={**scene.placements, 9: RigidTransform()})
    assert np.array_equal(
        usual.p_base_sphere, more.world(magnitudes).p_base_sphere[: len(usual.p_base_sphere)]
    )


def test_without_noise_it_is_the_same_world(scene, magnitudes):
    exact, usual = scene.world(magnitudes.without_noise()), scene.world(magnitudes)
    assert np.array_equal(usual.arm.geometry, exact.arm.geometry)
    np.testing.assert_allclose(usual.p_base_sphere, exact.p_base_sphere, atol=5e-6)


def test_the_gauge_keeps_its_shape_wherever_it_stands(scene, magnitudes):
    world = scene.world(magnitudes.without_noise())
    for location in scene.placements:
        here = world.location == location
        first, last = world.p_base_sphere[here][[0, -1]]
        assert np.linalg.norm(last - first) == pytest.approx(0.52, abs=1e-12)


def test_the_certificate_is_off_by_its_uncertainty(scene):
    generator = np.random.default_rng(0)
    draws = np.array([true_centers(scene.gauge, 1.0, 4.0, generator) for _ in range(2000)])
    distance = np.linalg.norm(draws[:, -1] - draws[:, 0], axis=1)
    constant, proportional = 1e-6 / 2, 1e-6 / 2 * 0.52  # k = 2
    assert distance.std() == pytest.approx(np.hypot(constant, proportional), rel=0.1)
    assert 2 * distance.std() <= scene.gauge.distance_uncertainty(0.52)


def test_nearly_all_poses_of_nearly_all_worlds_stay_within_the_stroke(scene, magnitudes):
    usable = []
    for seed in range(40):
        poses = probe_postures(
            scene.world(magnitudes, seed), scene.joints, np.random.default_rng(seed)
        )
        usable.append(len(poses) / len(scene.joints))
    assert np.mean(usable) > 0.98
    assert np.min(usable) > 0.9


def test_the_nearest_sphere_is_the_one_that_is_seen(scene, magnitudes):
    world = scene.world(magnitudes)
    generator = np.random.default_rng(8)
    q = generator.uniform(-2.5, 2.5, (200, 6))
    seen = world.sight(q)
    mount = world.probe.flange_T_probe
    p_base_probe = points(world.arm, q, mount.translation)
    distance = np.linalg.norm(world.p_base_sphere - p_base_probe[:, None], axis=2)
    nearest = distance.argmin(axis=1)
    np.testing.assert_array_equal(seen.location, world.location[nearest])
    np.testing.assert_array_equal(seen.sphere, world.sphere[nearest])
    p_base = points(world.arm, q, mount.apply(seen.p_probe_sphere))
    np.testing.assert_allclose(p_base, world.p_base_sphere[nearest], atol=1e-12)


def test_a_dead_led_is_reported_before_anything_else(scene, magnitudes, away):
    dark = replace(magnitudes, psd=replace(magnitudes.psd, photocurrent=1e-9))
    world = scene.world(dark)
    for q in (scene.joints[:3], away[None, :]):
        read = world.read(world.contact(world.sight(q).p_probe_sphere), np.random.default_rng(0))
        assert (read.status == Status.WEAK_SIGNAL).all()


def test_a_gauge_that_no_stylus_can_hold_is_refused(scene):
    tiny = replace(scene, gauge=replace(scene.gauge, sphere_diameter=0.001))
    with pytest.raises(ContactError):
        tiny.world(Magnitudes(gauge=GaugeMagnitudes()))


def test_a_transform_is_moved_by_what_it_is_told():
    nominal = RigidTransform(np.array([0.1, 0.2, 0.3]), np.array([0.5, -1.0, 2.0]))
    draws = [moved(nominal, 1e-3, 1e-2, 3.0, np.random.default_rng(s)) for s in range(1000)]
    shift = np.array([draw.translation - nominal.translation for draw in draws])
    turn = np.array([rotation_vector(draw.rotation @ nominal.rotation.T) for draw in draws])
    np.testing.assert_allclose(shift.std(axis=0), 1e-3, rtol=0.1)
    np.testing.assert_allclose(turn.std(axis=0), 1e-2, rtol=0.1)
    still = moved(nominal, 0.0, 0.0, 3.0, np.random.default_rng(0))
    np.testing.assert_array_equal(still.matrix(), nominal.matrix())


@pytest.mark.parametrize('shape', [(), (3,), (50, 6)])
def test_no_draw_is_beyond_its_bound(shape):
    generator = np.random.default_rng(1)
    for _ in range(100):
        values = bounded_normal(shape, 1.0, generator)
        assert values.shape == shape
        assert np.abs(values).max() <= 1.0
