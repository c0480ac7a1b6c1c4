# SPDX-License-Identifier: Apache-2.0
"""What is typed into the controller corrects the axes it is typed in for, in their directions."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation
from simulated_calibration import turned_kr5

from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import DataError
from calib_model.instruments import ControllerAxis
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform
from calib_solver.compensation import (
    Calibrated,
    abc,
    controller_figures,
    counted_as,
    figures_text,
    shown,
)

ARMS = Path(__file__).resolve().parents[3] / 'calib_bringup' / 'config' / 'arms'
KR5 = read_description(ARMS / 'kuka_kr5_sixx_r650.yaml', parse_arm)
MOUNT = RigidTransform(np.array([0.01, -0.02, 0.1]), np.array([0.1, -0.2, 0.3]))


def with_zeros(arm, zeros):
    geometry = arm.geometry.copy()
    geometry[3] += zeros
    return arm.with_geometry(geometry)


def of_abc(angles):
    """The rotation (3, 3) of KUKA's A, B, C (3,), rad."""
    return Rotation.from_euler('ZYX', angles).as_matrix()


def test_the_kr5_shows_kukas_axis_positions() -> None:
    home = np.radians([[0, -90, 90, 0, 0, 0]])
    q = np.radians([[0, 0, 0, 0, 0, 0]])
    np.testing.assert_allclose(shown(KR5, q), home, atol=1e-12)
    limits = np.degrees(shown(KR5, KR5.limits.T))
    expected = [[-170, -190, -119, -190, -120, -358], [170, 45, 165, 190, 120, 358]]
    np.testing.assert_allclose(limits, expected, atol=1e-9)


@pytest.mark.parametrize('name', ['kuka_kr6_r900_sixx', 'kuka_kr10_r1100_sixx', 'kuka_lbr_iiwa14'])
def test_axis_positions_are_the_joints_where_the_zeros_are_kukas(name: str) -> None:
    arm = read_description(ARMS / f'{name}.yaml', parse_arm)
    q = np.linspace(-1, 1, arm.n)[None]
    np.testing.assert_array_equal(shown(arm, q), q)
    assert [joint.controller.name for joint in arm.joints] == [f'A{i + 1}' for i in range(arm.n)]


def test_the_offsets_added_to_what_is_shown_make_the_nominal_arm_the_real_one() -> None:
    """With mixed directions on both sides: the joints' own and the controller's."""
    nominal = turned_kr5()
    axes = [ControllerAxis(f'A{i}', (-1) ** i, 0.3 * i) for i in range(1, 7)]
    joints = zip(nominal.joints, axes, strict=True)
    shows = tuple(replace(joint, controller=axis) for joint, axis in joints)
    nominal = replace(nominal, joints=shows)
    real = with_zeros(nominal, [0, 0.01, -0.02, 0.03, 0.005, 0])
    figures = controller_figures(Calibrated(nominal, real, MOUNT, MOUNT))
    q = np.random.default_rng(0).uniform(-2, 2, (10, 6))
    further = shown(real, q) + [axis.offset for axis in figures.axes]
    direction, zero = np.array([(axis.direction, axis.zero) for axis in axes]).T
    np.testing.assert_allclose(
        forward_kinematics(nominal, direction * further + zero),
        forward_kinematics(real, q),
        rtol=0,
        atol=1e-12,
    )
    assert [axis.told for axis in figures.axes] == [False, True, True, True, True, False]


def test_the_tool_is_told_in_the_controllers_flange_frame() -> None:
    """At KUKA's zero the KR 5's $FLANGE looks forwards with its x down: A = C = 0, B = 90 deg."""
    q = np.radians([[0, 90, -90, 0, 0, 0]])
    flange = forward_kinematics(KR5, q)[0] @ KR5.flange_T_controller.matrix()
    np.testing.assert_allclose(abc(flange[:3, :3]), [0, np.pi / 2, 0], atol=1e-9)
    figures = controller_figures(Calibrated(KR5, KR5, MOUNT, MOUNT))
    tool = np.eye(4)
    tool[:3, :3], tool[:3, 3] = of_abc(figures.abc), figures.xyz
    wanted = forward_kinematics(KR5, q)[0] @ MOUNT.matrix()
    np.testing.assert_allclose(flange @ tool, wanted, rtol=0, atol=1e-12)


@given(st.tuples(*[st.floats(-3.1, 3.1)] * 3))
def test_abc_turn_back_into_their_rotation(angles: tuple[float, ...]) -> None:
    rotation = of_abc(np.array(angles))
    np.testing.assert_allclose(of_abc(abc(rotation)), rotation, rtol=0, atol=1e-8)


def test_a_turn_about_z_alone_is_a() -> None:
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(abc(turned), [np.pi / 2, 0, 0], atol=1e-15)
    np.testing.assert_allclose(abc(of_abc(np.radians([10, 20, 30]))), np.radians([10, 20, 30]))


def test_signs_are_not_guessed_and_what_is_assumed_is_said_on_every_line() -> None:
    arm = turned_kr5()
    calibrated = Calibrated(arm, with_zeros(arm, 1e-3), MOUNT, MOUNT)
    with pytest.raises(DataError, match='signs are not guessed.*--assume-urdf'):
        controller_figures(calibrated)
    text = figures_text(controller_figures(calibrated, assume_urdf=True))
    axes = text.splitlines()[1:7]
    assert all("assumed: the URDF's direction" in line for line in axes)
    assert 'joint_a2       +0.0573' in text
    assert 'X +10.0000  Y -20.0000  Z +100.0000' in text


def test_each_line_says_how_the_description_counts_the_axis() -> None:
    text = figures_text(controller_figures(Calibrated(KR5, KR5, MOUNT, MOUNT)))
    assert 'A2 = joint_a2 - 90 deg, by its description' in text
    assert 'assumed' not in text
    axes = [ControllerAxis('A1', -1, 0.5), *(joint.controller for joint in KR5.joints[1:])]
    joints = zip(KR5.joints, axes, strict=True)
    turned = replace(KR5, joints=tuple(replace(one, controller=axis) for one, axis in joints))
    text = figures_text(controller_figures(Calibrated(turned, turned, MOUNT, MOUNT)))
    assert 'A1 = -(joint_a1 - 28.6479 deg), by its description' in text


def test_the_controllers_side_comes_from_a_description_of_the_same_arm() -> None:
    arm = turned_kr5()
    described = controller_figures(Calibrated(KR5, counted_as(KR5, KR5), MOUNT, MOUNT))
    assert described.axes[1].axis == 'A2'
    with pytest.raises(DataError, match='other joints'):
        counted_as(KR5, read_description(ARMS / 'ur5.yaml', parse_arm))
    half = replace(arm, joints=(*KR5.joints[:3], *arm.joints[3:]))
    with pytest.raises(DataError, match='joint joint_a4 lacks the controller that others have'):
        controller_figures(Calibrated(half, half, MOUNT, MOUNT))
