# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.motion.pinocchio_arm import PinocchioArm
from calib_model.instruments import Coupling
from calib_model.kinematics import forward_kinematics, point_derivatives
from calib_model.transforms import RigidTransform

pytestmark = pytest.mark.timeout(60)


def perturbed(arm, seed):
    """An arm with every one of the 5 n parameters off, beta included, and mixed directions."""
    rng = np.random.default_rng(seed)
    changed = arm.with_geometry(arm.geometry + rng.normal(scale=0.02, size=arm.geometry.shape))
    flipped = rng.integers(0, 2, arm.n) * 2 - 1
    joints = [
        type(j)(**{**vars(j), 'direction': int(s)})
        for j, s in zip(changed.joints, flipped, strict=True)
    ]
    joints[1] = replace(joints[1], type='prismatic')
    joints[3] = replace(joints[3], coupling=Coupling(joints[2].name, 0.5))
    placed = [RigidTransform(*rng.uniform(-1, 1, (2, 3))) for _ in range(2)]
    return type(arm)(arm.name, tuple(joints), arm.base_frame, arm.flange_frame, *placed)


@pytest.mark.parametrize('name', ['kr5', 'iiwa14'])
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_flange_is_where_the_denavit_hartenberg_arm_puts_it(name, seed, request):
    arm = request.getfixturevalue(name)
    for each in (arm, perturbed(arm, seed)):
        q = np.random.default_rng(seed).uniform(-3, 3, each.n)
        model = PinocchioArm(each)
        assert np.abs(model.flange_pose(q) - forward_kinematics(each, q)[0]).max() < 1e-12


def test_kr5_stands_where_its_data_sheet_says(kr5):
    model = PinocchioArm(kr5)
    q = np.radians([0, 90, -90, 0, 0, 0])
    assert np.allclose(model.flange_pose(np.zeros(6))[:3, 3], [0.450, 0, 0.695], atol=1e-12)
    assert np.allclose(model.flange_pose(q)[:3, 3], [0.720, 0, 0.425], atol=1e-12)


@pytest.mark.parametrize('name', ['kr5', 'iiwa14'])
def test_jacobian_is_that_of_the_denavit_hartenberg_arm(name, request):
    plain = request.getfixturevalue(name)
    for arm in (plain, perturbed(plain, 4)):
        q = np.random.default_rng(3).uniform(-2, 2, arm.n)
        linear = PinocchioArm(arm).flange_jacobian(q)[:3]
        assert np.abs(linear - point_derivatives(arm, q, np.zeros(3)).joints[0]).max() < 1e-12


def test_limits_and_speeds_are_the_description_s(kr5):
    arm = kr5
    model = PinocchioArm(arm).model
    assert np.array_equal(model.lowerPositionLimit, arm.limits[:, 0])
    assert np.array_equal(model.upperPositionLimit, arm.limits[:, 1])
    assert np.array_equal(model.velocityLimit, arm.velocity)
    assert list(model.names)[1:] == list(arm.joint_names)
