# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.errors import DataError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import points
from calib_model.stamps import SECOND
from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation.magnitudes import Magnitudes
from selfcenter_probe.simulation.readings import ProbeSimulation, Readings, probe_postures

T0 = 1_700_000_000 * SECOND
MS = 1_000_000


def simulation(scene, magnitudes, seed=1, **options):
    return ProbeSimulation(scene.world(magnitudes, seed), np.random.default_rng(seed), **options)


def joined(parts):
    return Readings(
        *(
            np.concatenate([getattr(part, key) for part in parts])
            for key in ('stamp', 'displacement', 'status')
        )
    )


def equal(first, second):
    return all(
        np.array_equal(getattr(first, key), getattr(second, key))
        for key in ('stamp', 'displacement', 'status')
    )


def test_readings_come_at_the_multiples_of_the_period(scene, magnitudes):
    probe = simulation(scene, magnitudes, rate=100.0)
    q = scene.joints[0]
    probe.advance([T0 + 3 * MS], q)
    read = probe.advance([T0 + 41 * MS], q)
    assert (read.stamp - T0).tolist() == [10 * MS, 20 * MS, 30 * MS, 40 * MS]
    assert (probe.advance([T0 + 50 * MS], q).stamp - T0).tolist() == [50 * MS]
    assert len(probe.advance([T0 + 55 * MS], q)) == 0


def test_the_first_state_and_one_after_a_gap_are_read_at_their_own_stamp(scene, magnitudes):
    probe = simulation(scene, magnitudes, max_gap=0.1)
    q = scene.joints[0]
    assert probe.advance([T0 + 7], q).stamp.tolist() == [T0 + 7]
    late = T0 + 7 + 100 * MS + 1
    assert probe.advance([late], q).stamp.tolist() == [late]
    assert len(probe.advance([late + 100 * MS], q)) == 10


def test_nothing_is_read_between_postures_across_a_gap(scene, away):
    probe = simulation(scene, Magnitudes(), max_gap=0.05)
    read = probe.advance([T0, T0 + 60 * MS], np.array([scene.joints[0], away]))
    assert read.stamp.tolist() == [T0, T0 + 60 * MS]
    assert (read.status == [[Status.OK] * 3, [Status.NO_CONTACT] * 3]).all()


def test_joints_are_interpolated_at_the_readings_stamp(scene):
    world = scene.world(Magnitudes())
    probe = ProbeSimulation(world, np.random.default_rng(0), rate=1000.0)
    q0 = scene.joints[0]
    q1 = q0 + np.array([1e-4, -2e-4, 1e-4, 3e-4, -1e-4, 2e-4])
    read = probe.advance([T0 + MS // 2, T0 + 10 * MS + MS // 2], np.array([q0, q1]))
    share = (read.stamp - T0 - MS / 2) / (10 * MS)
    expected = world.sight(q0 + share[:, None] * (q1 - q0)).p_probe_sphere
    centers = scene.probe.centers(read.displacement, scene.gauge.sphere_diameter)
    assert len(read) == 11
    np.testing.assert_allclose(centers, expected, atol=1e-12)


def test_states_in_one_batch_give_what_they_give_one_by_one(scene, magnitudes, away):
    stamps = [T0 + i * 7 * MS for i in range(60)]
    way = np.linspace(scene.joints[0], scene.joints[1], 60)
    way[20:40] = way[20]
    way[50:] = away
    whole = simulation(scene, magnitudes).advance(stamps, way)
    one_by_one = simulation(scene, magnitudes)
    parts = joined([one_by_one.advance([t], q) for t, q in zip(stamps, way, strict=True)])
    assert np.array_equal(whole.stamp, parts.stamp)
    assert np.array_equal(whole.status, parts.status)
    np.testing.assert_allclose(whole.displacement, parts.displacement, atol=1e-12)


def test_the_same_seed_and_states_give_the_same_readings(scene, magnitudes):
    stamps = [T0 + i * 10 * MS for i in range(50)]
    way = np.linspace(scene.joints[0], scene.joints[3], 50)
    first = simulation(scene, magnitudes, 4).advance(stamps, way)
    assert equal(first, simulation(scene, magnitudes, 4).advance(stamps, way))
    assert not equal(first, simulation(scene, magnitudes, 5).advance(stamps, way))


def test_a_stop_reads_the_same_however_long_the_arm_stood_elsewhere(scene, magnitudes):
    """Its encoders scatter meanwhile, and more readings are drawn."""

    def stop(idle):
        scatter = np.random.default_rng(2)
        probe = simulation(scene, magnitudes)
        for i in range(idle):
            probe.advance([T0 + i * 20 * MS], scene.joints[1] + scatter.normal(0.0, 2e-6, 6))
        begin = T0 + SECOND
        return probe.advance([begin, begin + 60 * MS], np.array([scene.joints[0]] * 2))

    assert equal(stop(3), stop(40))
    assert len(stop(3)) == 7


def test_an_arm_at_rest_is_read_with_the_psds_noise_alone(scene, magnitudes):
    probe = simulation(scene, magnitudes)
    q = scene.joints[0]
    probe.advance([T0], q)
    read = joined([probe.advance([T0 + i * 100 * MS], q) for i in range(1, 200)])
    assert (read.status == Status.OK).all()
    assert len(read) == 1990
    spread = read.displacement.std(axis=0)
    assert np.all((spread > 0.5e-6) & (spread < 1.5e-6))


def test_coming_back_shows_the_arms_repeatability(scene, magnitudes):
    """A radius of some 10 um rms, so ISO 9283's mean plus three sigma is near 0.02 mm."""
    probe = simulation(scene, replace(magnitudes, psd=magnitudes.psd.perfect()))
    q = scene.joints[0]
    stops = []
    for i in range(400):
        probe.advance([T0 + 2 * i * SECOND], q + 0.5)
        stops.append(probe.advance([T0 + (2 * i + 1) * SECOND], q).displacement[0])
    centers = scene.probe.centers(np.array(stops), scene.gauge.sphere_diameter)
    radius = np.linalg.norm(centers - centers.mean(axis=0), axis=1)
    assert 0.010e-3 < radius.mean() + 3 * radius.std() < 0.030e-3


def test_states_out_of_order_are_left_out_and_a_clock_set_back_starts_again(scene, magnitudes):
    probe = simulation(scene, magnitudes, max_gap=0.1)
    q = scene.joints[0]
    probe.advance([T0], q)
    assert len(probe.advance([T0], q)) == 0
    assert len(probe.advance([T0 - 20 * MS], q)) == 0
    assert (probe.advance([T0 + 20 * MS], q).stamp - T0).tolist() == [10 * MS, 20 * MS]
    assert probe.advance([T0 - SECOND], q).stamp.tolist() == [T0 - SECOND]
    assert len(probe.advance([T0 - SECOND + 20 * MS], q)) == 2


@settings(max_examples=60)
@given(
    st.lists(st.integers(-250, 250), min_size=1, max_size=30),
    st.floats(1.0, 5000.0),
    st.floats(0.001, 0.5),
)
def test_any_stream_of_stamps_gives_readings_in_order_within_it(scene, steps, rate, gap):
    probe = simulation(scene, Magnitudes(), rate=rate, max_gap=gap)
    now = T0
    for step in steps:
        before, now = now, now + step * MS
        read = probe.advance([now], scene.joints[0])
        assert len(read) <= rate * gap + 2
        assert (np.diff(read.stamp) > 0).all()
        if len(read):
            assert read.stamp[-1] <= now
            assert read.stamp[0] > min(before, now) or len(read) == 1


def test_a_wrong_number_of_joints_or_a_rate_of_nothing_is_refused(scene, magnitudes):
    with pytest.raises(DataError):
        simulation(scene, magnitudes).advance([T0], np.zeros(5))
    with pytest.raises(DataError):
        simulation(scene, magnitudes, rate=0.0)
    with pytest.raises(DataError):
        simulation(scene, magnitudes, max_gap=-1.0)


def test_a_stream_of_nothing_gives_nothing(scene, magnitudes):
    assert len(simulation(scene, magnitudes).advance([], np.zeros((0, 6)))) == 0


def test_noise_free_poses_agree_to_rounding_in_the_true_arm(scene, magnitudes):
    world = scene.world(magnitudes.without_noise())
    poses = probe_postures(world, scene.joints, np.random.default_rng(0))
    assert len(poses) > 0.9 * len(scene.joints)
    p_probe = world.probe.centers(poses.displacement, scene.gauge.sphere_diameter)
    p_base = points(world.arm, poses.joints, world.probe.flange_T_probe.apply(p_probe))
    for location, sphere, point in zip(poses.location, poses.sphere, p_base, strict=True):
        row = np.flatnonzero((world.location == location) & (world.sphere == sphere))[0]
        np.testing.assert_allclose(point, world.p_base_sphere[row], atol=1e-13)
    # and it is no empty agreement: in the nominal arm they are far apart
    wrong = points(scene.arm, poses.joints, scene.probe.flange_T_probe.apply(p_probe))
    assert np.linalg.norm(wrong - p_base, axis=1).mean() > 3e-4


def test_postures_without_contact_are_left_out(scene, magnitudes, away):
    joints = np.insert(scene.joints[:20], 5, away, axis=0)
    world = scene.world(replace(Magnitudes(), psd=magnitudes.psd))
    poses = probe_postures(world, joints, np.random.default_rng(0))
    np.testing.assert_array_equal(poses.joints, scene.joints[:20])
    assert (poses.stamp // SECOND).tolist() == [i for i in range(21) if i != 5]


def test_averaged_readings_are_quieter(scene, magnitudes):
    world = scene.world(replace(Magnitudes(), psd=replace(magnitudes.psd, linearity_error=0)))
    joints = np.tile(scene.joints[:1], (400, 1))
    once = probe_postures(world, joints, np.random.default_rng(0))
    often = probe_postures(world, joints, np.random.default_rng(0), readings=25)
    assert (often.readings == 25).all()
    ratio = often.displacement.std(axis=0) / once.displacement.std(axis=0)
    np.testing.assert_allclose(ratio, 1 / 5, rtol=0.2)


def test_a_passive_probe_names_its_sphere_and_reads_nothing(scene, away):
    seat = PassiveProbe('seat', scene.probe.flange_T_probe)
    world = replace(scene, probe=seat).world(Magnitudes())
    joints = np.vstack([scene.joints, away])
    poses = probe_postures(world, joints, np.random.default_rng(0))
    np.testing.assert_array_equal(poses.joints, scene.joints)
    np.testing.assert_array_equal(poses.sphere, scene.sphere)
    assert not poses.displacement.any()
