# SPDX-License-Identifier: Apache-2.0
"""The corrected URDF has its flange where the identified arm has it: Pinocchio reads it back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from simulated_calibration import kr5, on_a_rail, ur_like
from urdf_files import random_urdf, through_pinocchio

from calib_model.errors import CalibrationError, DescriptionError
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform
from calib_model.urdf import arm_from_urdf, arm_urdf, read_chain
from calib_solver.compensation.user_urdf import corrected_origins, corrected_urdf

pytestmark = pytest.mark.timeout(60)
EXACT = 1e-9


def off_in_everything(arm: Arm, rng: np.random.Generator) -> Arm:
    """Every parameter off, but those of the last matrix: they are the probe's mount."""
    error = 2e-3 * rng.normal(size=arm.geometry.shape)
    error[:2, -1] = error[4, -1] = 0.0
    return arm.with_geometry(arm.geometry + error)


def off(arm: Arm, text: bytes) -> float:
    q = np.random.default_rng(1).uniform(-3, 3, (20, arm.n))
    frames = (arm.base_frame, arm.flange_frame, arm.joint_names)
    return float(
        np.abs(
            through_pinocchio(text.decode(), *frames, arm.uncoupled(q)) - forward_kinematics(arm, q)
        ).max()
    )


@pytest.mark.slow
@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(2, 4))
def test_any_urdf_takes_any_correction(seed: int, joints: int) -> None:
    """The last joint's own axis takes a d and a theta_0, its child link nothing else."""
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, joints).encode()
    nominal = arm_from_urdf(text, '', '')
    identified = off_in_everything(nominal, rng)
    new = corrected_urdf(text, nominal, identified)
    assert off(identified, new) < EXACT
    assert off(nominal, new) > 1e-6
    assert corrected_urdf(text, nominal, nominal) == text


@pytest.mark.parametrize('arm', [kr5(), ur_like(), on_a_rail()], ids=lambda arm: arm.name)
def test_the_corrections_are_as_small_as_the_errors(arm: Arm) -> None:
    text = arm_urdf(arm).encode()
    identified = off_in_everything(arm, np.random.default_rng(0))
    chain = read_chain(text, 'base_link', 'tool0')
    new = corrected_origins(chain, arm, identified)
    assert set(new) == set(arm.joint_names)
    for joint in chain.moving:
        assert np.abs(new[joint.name] - joint.origin).max() < 0.02
    assert off(identified, corrected_urdf(text, arm, identified)) < EXACT


def test_a_description_a_little_off_its_urdf_is_corrected_all_the_same() -> None:
    """As ours of the iiwa 14 is 0.4 mm off its maker's URDF."""
    arm = kr5()
    rough = arm.with_geometry(arm.geometry + 1e-3)
    identified = off_in_everything(rough, np.random.default_rng(2))
    assert off(identified, corrected_urdf(arm_urdf(arm).encode(), rough, identified)) < EXACT


def test_a_joint_and_a_link_may_have_one_name() -> None:
    """As the Unitree Z1's gripperStator."""
    arm = kr5()
    text = arm_urdf(arm).replace('name="tool0_mount"', 'name="tool0"').encode()
    identified = off_in_everything(arm, np.random.default_rng(4))
    assert off(identified, corrected_urdf(text, arm, identified)) < EXACT


def test_another_arm_or_other_zeros_are_refused() -> None:
    arm = kr5()
    text = arm_urdf(arm).encode()
    turned = arm.geometry.copy()
    turned[3, 1] += 1.57
    with pytest.raises(DescriptionError, match='my.urdf: its tool0 is up to .* mm off'):
        corrected_urdf(text, arm.with_geometry(turned), arm, 'my.urdf')
    names = [replace(joint, name=f'{joint.name}_') for joint in arm.joints]
    other = replace(arm, joints=tuple(names))
    with pytest.raises(DescriptionError, match='expected joint_a1_, .* as in the arm'):
        corrected_urdf(text, other, other, 'my.urdf')
    with pytest.raises(DescriptionError, match="no link 'hand'"):
        corrected_urdf(text, arm, replace(arm, flange_frame='hand'), 'my.urdf')


def test_a_flange_without_a_joint_of_its_own_cannot_be_moved_on_the_last_link() -> None:
    text = random_urdf(np.random.default_rng(0), 3).encode()
    nominal = arm_from_urdf(text, '', '')
    moved = replace(nominal, dh_T_flange=RigidTransform(np.array([1e-3, 0, 0])))
    with pytest.raises(CalibrationError, match="link 'flange' is moved by the_last itself"):
        corrected_urdf(text, nominal, moved)
