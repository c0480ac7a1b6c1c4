# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.instruments import Arm, Joint
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import rotation_matrix
from calib_model.urdf.export_arm import arm_urdf, rpy

RIGHT = np.pi / 2


def through_pinocchio(arm: Arm, q: np.ndarray) -> np.ndarray:
    """T_base_flange (N, 4, 4) as Pinocchio finds it in the arm's URDF."""
    model = pinocchio.buildModelFromXML(arm_urdf(arm))
    data = model.createData()
    base, flange = model.getFrameId(arm.base_frame), model.getFrameId(arm.flange_frame)
    found = []
    for row in q:
        pinocchio.framesForwardKinematics(model, data, row)
        found.append((data.oMf[base].inverse() * data.oMf[flange]).homogeneous)
    return np.array(found)


def test_pinocchio_reads_the_same_arm(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(0)
    for arm in (*arms, odd_arm):
        q = rng.uniform(-3, 3, (20, arm.n))
        np.testing.assert_allclose(
            through_pinocchio(arm, arm.uncoupled(q)), forward_kinematics(arm, q), rtol=0, atol=1e-12
        )


def test_a_coupled_arm_says_what_its_urdf_counts(odd_arm: Arm) -> None:
    assert '<!-- j4 here is j4 + - -0.7 * j1 of the arm description' not in arm_urdf(odd_arm)
    assert '<!-- j4 here is j4 + -0.7 * j1 of the arm description' in arm_urdf(odd_arm)
    limited = [replace(joint, limits=(-1.0, 2.0)) for joint in odd_arm.joints]
    model = pinocchio.buildModelFromXML(arm_urdf(replace(odd_arm, joints=tuple(limited))))
    np.testing.assert_allclose(model.lowerPositionLimit, [-1, -1, -1, -1, -1 - 0.7 * 2])
    np.testing.assert_allclose(model.upperPositionLimit, [2, 2, 2, 2, 2 + 0.7])


@settings(max_examples=60)
@given(st.integers(0, 2**32))
def test_identified_arms_keep_their_digits(seed: int) -> None:
    """Right angles a hair off are where roll, pitch and yaw lose digits if taken carelessly."""
    rng = np.random.default_rng(seed)
    joints = []
    for i in range(6):
        off = rng.choice([0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3], size=5) * rng.normal(size=5)
        nominal = [
            rng.normal(),
            rng.choice([-RIGHT, 0, RIGHT, np.pi]),
            rng.normal(),
            rng.choice([-RIGHT, 0, RIGHT, np.pi]),
            rng.choice([0, 0, RIGHT]),
        ]
        joints.append(Joint(f'j{i}', *(nominal + off), direction=int(rng.choice([-1, 1]))))
    arm = Arm('identified', tuple(joints))
    q = rng.uniform(-3, 3, (5, 6))
    np.testing.assert_allclose(
        through_pinocchio(arm, q), forward_kinematics(arm, q), rtol=0, atol=1e-12
    )


def test_limits_and_speeds_are_the_arms(kr5: Arm) -> None:
    model = pinocchio.buildModelFromXML(arm_urdf(kr5))
    assert list(model.names)[1:] == list(kr5.joint_names)
    np.testing.assert_array_equal(model.lowerPositionLimit, kr5.limits[:, 0])
    np.testing.assert_array_equal(model.upperPositionLimit, kr5.limits[:, 1])
    np.testing.assert_array_equal(model.velocityLimit, kr5.velocity)


def test_joints_without_limits_stay_one_number_each() -> None:
    arm = Arm('free', (Joint('j1', 0.1, 0.2, 0.3, 0.4), Joint('j2', 0.1, 0.2, 0.3, 0.4)))
    model = pinocchio.buildModelFromXML(arm_urdf(arm))
    assert (model.nq, model.nv) == (2, 2)
    assert np.all(model.upperPositionLimit > 2 * np.pi)


def test_frames_form_one_chain_whatever_they_are_called(kr5: Arm) -> None:
    for arm in (kr5, replace(kr5, base_frame='link_1', flange_frame='link_6', name='<"&\'>')):
        robot = ElementTree.fromstring(arm_urdf(arm))
        links = [link.get('name') for link in robot.findall('link')]
        assert len(set(links)) == len(links) == arm.n + 2
        parents = [joint.find('parent').get('link') for joint in robot.findall('joint')]
        children = [joint.find('child').get('link') for joint in robot.findall('joint')]
        assert parents == links[:-1]
        assert children == links[1:]
        assert (links[0], links[-1]) == (arm.base_frame, arm.flange_frame)
        assert robot.get('name') == arm.name


def test_cylinders_reach_from_joint_to_joint(kr5: Arm) -> None:
    robot = ElementTree.fromstring(arm_urdf(kr5))
    drawn = {link.get('name'): link.find('visual') for link in robot.findall('link')}
    for joint in robot.findall('joint'):
        to_next = np.array(joint.find('origin').get('xyz').split(), dtype=float)
        visual = drawn[joint.find('parent').get('link')]
        if np.linalg.norm(to_next) < 1e-3:
            assert visual is None
            continue
        origin = visual.find('origin')
        middle = np.array(origin.get('xyz').split(), dtype=float)
        roll, pitch, yaw = map(float, origin.get('rpy').split())
        turn = rotation_matrix(np.array([0, 0, yaw])) @ rotation_matrix(np.array([0, pitch, 0]))
        turn = turn @ rotation_matrix(np.array([roll, 0, 0]))
        half = turn[:, 2] * float(visual.find('geometry/cylinder').get('length')) / 2
        np.testing.assert_allclose(middle - half, 0, atol=1e-12)
        np.testing.assert_allclose(middle + half, to_next, atol=1e-12)
    assert 'visual' not in arm_urdf(kr5, radius=0)


@pytest.mark.parametrize('pitch', [RIGHT, -RIGHT, RIGHT - 1e-9, 0.3])
def test_roll_pitch_yaw_multiply_back(pitch: float) -> None:
    def product(roll: float, pitch: float, yaw: float) -> np.ndarray:
        about = [rotation_matrix(np.array(v)) for v in ([roll, 0, 0], [0, pitch, 0], [0, 0, yaw])]
        return about[2] @ about[1] @ about[0]

    rotation = product(0.7, pitch, -2.0)
    np.testing.assert_allclose(product(*rpy(rotation)), rotation, rtol=0, atol=1e-15)
