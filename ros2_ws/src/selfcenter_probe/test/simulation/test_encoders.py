# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from selfcenter_probe.simulation.encoders import Encoders
from selfcenter_probe.simulation.magnitudes import ArmMagnitudes, Magnitudes
from selfcenter_probe.simulation.readings import probe_postures

Q = np.random.default_rng(3).uniform(-3, 3, (200, 6))


def drawn(eccentricity, ovality, seed=1):
    return Encoders.drawn(eccentricity, ovality, 6, np.random.default_rng(seed))


def test_reading_undoes_what_the_encoders_are_off_by():
    encoders = drawn(1e-3, 1e-3)
    assert np.abs(encoders.true(Q) - Q).max() > 1e-3
    np.testing.assert_allclose(encoders.read(encoders.true(Q)), Q, atol=1e-11)


def test_eccentricity_comes_once_per_turn_and_ovality_twice():
    half, quarter = drawn(1e-4, 0.0), drawn(0.0, 1e-4)
    np.testing.assert_allclose(half.true(Q + np.pi) - Q - np.pi, Q - half.true(Q), atol=1e-15)
    turned = Q + np.pi / 2
    np.testing.assert_allclose(quarter.true(turned) - turned, Q - quarter.true(Q), atol=1e-15)


def test_the_magnitude_is_the_standard_deviation_of_the_error():
    errors = [drawn(2e-5, 0.0, seed).true(Q) - Q for seed in range(400)]
    assert np.std(errors) == pytest.approx(2e-5 / np.sqrt(2), rel=0.05)


def test_encoders_without_errors_read_the_very_joints():
    assert drawn(0.0, 0.0).true(Q) is Q


def test_eccentric_encoders_move_what_the_styli_read_and_nothing_else(scene):
    usual = scene.world(Magnitudes())
    eccentric = scene.world(Magnitudes(arm=ArmMagnitudes(eccentricity=1e-4)))
    assert replace(eccentric, encoders=usual.encoders).arm == usual.arm
    first, second = (
        probe_postures(world, scene.joints, np.random.default_rng(1))
        for world in (usual, eccentric)
    )
    assert np.array_equal(first.joints, second.joints)
    off = np.abs(first.displacement - second.displacement).max()
    assert 1e-6 < off < 1e-3
