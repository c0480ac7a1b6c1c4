# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from calib_model.instruments import PassiveProbe
from selfcenter_probe.operator.force import HandForce, overhang
from selfcenter_probe.simulation import ArmMagnitudes, GaugeMagnitudes, HandMagnitudes, Magnitudes

WORLD = Magnitudes(
    arm=ArmMagnitudes(compliance=1e-5),
    gauge=GaugeMagnitudes(give_level=2e-6, give_vertical=1e-5),
    hand=HandMagnitudes(seat_force=10.0, styli_force=1.0, sideways=0.25, weight=4.0),
)
DIRECTION = np.array([[0.6, 0.0, -0.8], [0.0, 1.0, 0.0]])
ONCE = np.ones(2)


@pytest.fixture
def on_seat(scene):
    return HandForce.on(PassiveProbe('seat', scene.probe.flange_T_probe), WORLD)


@pytest.mark.slow
def test_styli_are_pressed_by_their_springs_alone(scene, on_seat):
    on_styli = HandForce.on(scene.probe, WORLD)
    pressed = on_seat.on_gauge(DIRECTION, ONCE)
    np.testing.assert_allclose(10 * on_styli.on_gauge(DIRECTION, ONCE), pressed)
    np.testing.assert_allclose(pressed, [[1.5, 0.0, -8.0], [0.0, 2.5, 0.0]])


def test_the_gauge_yields_along_the_force_and_most_downwards(on_seat):
    moved = on_seat.displacement(on_seat.on_gauge(DIRECTION, ONCE), 1.0)
    np.testing.assert_allclose(moved, [[3e-6, 0.0, -8e-5], [0.0, 5e-6, 0.0]])


def test_joints_bend_by_the_push_of_the_gauge_less_the_weight(on_seat):
    jacobian = np.zeros((2, 3, 6))
    jacobian[:, 2, 1] = 0.5  # m: a lever arm
    bent = on_seat.bending(on_seat.on_gauge(DIRECTION, ONCE), ONCE, jacobian)
    expected = np.zeros((2, 6))
    expected[:, 1] = 1e-5 * 0.5 * np.array([8.0 - 4.0, 0.0 - 4.0])
    np.testing.assert_allclose(bent, expected)


def test_a_bar_yields_at_its_ends_four_times_as_much_as_at_its_middle():
    spheres = np.linspace(-0.7, 0.7, 2001)[:, None] * np.array([0.6, 0.0, 0.8])
    at = np.array([overhang(sphere, spheres) for sphere in spheres])
    assert at[1000] == pytest.approx(0.5)
    assert at[[0, -1]] == pytest.approx(2.0)
    assert at.mean() == pytest.approx(1.0, abs=1e-3)
    assert overhang(spheres[0], spheres[:1]) == 1.0
