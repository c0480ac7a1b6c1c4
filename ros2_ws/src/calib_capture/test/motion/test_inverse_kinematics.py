# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.motion.inverse_kinematics import InverseError, InverseKinematics
from calib_model.instruments import Coupling
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform

pytestmark = pytest.mark.timeout(60)
SEEDS = st.integers(0, 2**32 - 1)


def angle_between(first, second):
    return np.abs((first - second + np.pi) % (2 * np.pi) - np.pi)


@settings(max_examples=200)
@given(seed=SEEDS)
def test_the_posture_itself_is_among_the_branches(seed, kr5):
    arm = kr5
    q = np.random.default_rng(seed).uniform(*arm.limits.T)
    found = InverseKinematics(arm).branches(forward_kinematics(arm, q)[0])
    assert angle_between(found, q).max(axis=1).min() < 1e-6
    assert np.abs(forward_kinematics(arm, found) - forward_kinematics(arm, q)).max() < 1e-9


@pytest.mark.parametrize('factor', [1.0, -0.5])
def test_a_joint_that_moves_with_another_is_found_too(factor, kr5):
    joints = list(kr5.joints)
    joints[2] = replace(joints[2], coupling=Coupling(joints[1].name, factor))
    arm = replace(kr5, joints=tuple(joints))
    q = np.radians([10.0, 80.0, -60.0, 30.0, 40.0, 50.0])
    inverse = InverseKinematics(arm)
    found = inverse.within_limits(inverse.branches(forward_kinematics(arm, q)[0]))
    assert np.abs(found - q).max(axis=1).min() < 1e-6
    assert np.abs(forward_kinematics(arm, found) - forward_kinematics(arm, q)).max() < 1e-9


def test_an_arm_with_a_rail_is_refused_in_one_line(kr5):
    joints = list(kr5.joints)
    joints[0] = replace(joints[0], type='prismatic')
    with pytest.raises(
        InverseError, match='slides: plan and capture take arms whose joints all turn$'
    ):
        InverseKinematics(replace(kr5, joints=tuple(joints)))


def test_an_arm_off_its_base_and_flange_is_found_too(kr5):
    rng = np.random.default_rng(4)
    placed = [RigidTransform(*rng.uniform(-1, 1, (2, 3))) for _ in range(2)]
    arm = replace(kr5, base_T_dh=placed[0], dh_T_flange=placed[1])
    q = rng.uniform(*arm.limits.T)
    found = InverseKinematics(arm).branches(forward_kinematics(arm, q)[0])
    assert angle_between(found, q).max(axis=1).min() < 1e-6


@settings(max_examples=100)
@given(seed=SEEDS)
def test_within_limits_gives_the_posture_itself_with_its_full_turns(seed, kr5):
    arm = kr5
    q = np.random.default_rng(seed).uniform(*arm.limits.T)
    inverse = InverseKinematics(arm)
    found = inverse.within_limits(inverse.branches(forward_kinematics(arm, q)[0]))
    assert np.abs(found - q).max(axis=1).min() < 1e-6
    assert arm.within_limits(found).all()


def test_full_turns_are_offered_where_the_range_has_room(kr5):
    arm = kr5
    inverse = InverseKinematics(arm)
    q = np.radians([[10.0, 20.0, -40.0, 175.0, 30.0, 20.0]])
    found = np.degrees(inverse.within_limits(q))
    assert sorted(set(found[:, 3].round(6))) == [-185.0, 175.0]
    assert sorted(set(found[:, 5].round(6))) == [-340.0, 20.0]
    assert len(found) == 4


def test_a_branch_outside_its_limits_is_dropped(kr5):
    found = InverseKinematics(kr5).within_limits(np.radians([[175.0, 0, 0, 0, 0, 0]]))
    assert found.shape == (0, 6)


def test_out_of_reach_has_no_branch(kr5):
    pose = np.eye(4)
    pose[:3, 3] = [2.0, 0.0, 0.5]
    assert len(InverseKinematics(kr5).branches(pose)) == 0


def test_a_regular_pose_of_the_kr5_has_eight_branches(kr5):
    pose = forward_kinematics(kr5, np.radians([4.0, 33.0, -168.0, -9.5, 45.0, 125.0]))[0]
    assert len(InverseKinematics(kr5).branches(pose)) == 8


@settings(max_examples=50)
@given(seed=SEEDS)
def test_offsets_and_directions_of_the_joints_are_applied(seed, kr5):
    rng = np.random.default_rng(seed)
    plain = kr5
    geometry = plain.geometry.copy()
    geometry[3] += rng.uniform(-1, 1, 6)
    joints = [
        type(j)(**{**vars(j), 'direction': int(rng.integers(0, 2)) * 2 - 1})
        for j in plain.with_geometry(geometry).joints
    ]
    arm = type(plain)(plain.name, tuple(joints))
    q = rng.uniform(-1.5, 1.5, 6)
    found = InverseKinematics(arm).branches(forward_kinematics(arm, q)[0])
    assert angle_between(found, q).max(axis=1).min() < 1e-6


@settings(max_examples=50)
@given(seed=SEEDS)
def test_seven_joints_are_solved_for_a_given_redundant_joint(seed, iiwa14):
    arm = iiwa14
    q = np.random.default_rng(seed).uniform(*arm.limits.T)
    inverse = InverseKinematics(arm)
    found = inverse.branches(forward_kinematics(arm, q)[0], q[2])
    assert angle_between(found, q).max(axis=1).min() < 1e-6
    assert np.abs(forward_kinematics(arm, found) - forward_kinematics(arm, q)).max() < 1e-9


@settings(max_examples=15)
@given(seed=SEEDS)
def test_an_arm_without_a_closed_form_is_solved_too(seed, kr5, iiwa14):
    rng = np.random.default_rng(seed)
    for plain in (kr5, iiwa14):
        off = np.zeros_like(plain.geometry)
        off[:] = rng.normal(scale=2e-3, size=off.shape)  # beta of every joint too
        arm = plain.with_geometry(plain.geometry + off)
        poses = forward_kinematics(arm, rng.uniform(*arm.limits.T, (8, arm.n)))
        found = InverseKinematics(arm).branches_of(list(poses), [None] * 8)
        assert sum(len(each) > 0 for each in found) >= 7
        for pose, each in zip(poses, found, strict=True):
            assert np.abs(forward_kinematics(arm, each) - pose).max(initial=0) < 1e-9


def test_an_arm_of_fewer_than_six_joints_is_refused_with_a_line(kr5):
    with pytest.raises(InverseError, match='needs at least 6 joints, got 5'):
        InverseKinematics(replace(kr5, joints=kr5.joints[:5]))
