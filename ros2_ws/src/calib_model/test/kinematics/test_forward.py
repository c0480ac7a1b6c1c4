# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics.forward import forward_kinematics, points, points_of_turned


def eq_2(arm: Arm, q: np.ndarray) -> np.ndarray:
    """T_base_flange of one posture as the product of eq. 2's matrices, element by element."""
    T = arm.base_T_dh.matrix()
    for joint, position in zip(arm.joints, q, strict=True):
        if joint.coupling is not None:
            position += joint.coupling.factor * q[arm.joint_names.index(joint.coupling.joint)]
        moved = joint.direction * position
        slide, turn = (moved, 0.0) if joint.type == 'prismatic' else (0.0, moved)
        theta = turn - joint.theta_0
        ct, st = np.cos(theta), np.sin(theta)
        ca, sa = np.cos(joint.alpha), np.sin(joint.alpha)
        cb, sb = np.cos(joint.beta), np.sin(joint.beta)
        A = np.array(
            [
                [ct, -ca * st, sa * st, joint.a * ct],
                [st, ca * ct, -sa * ct, joint.a * st],
                [0, sa, ca, joint.d + slide],
                [0, 0, 0, 1],
            ]
        )
        hayati = np.array([[cb, 0, sb, 0], [0, 1, 0, 0], [-sb, 0, cb, 0], [0, 0, 0, 1]])
        T = T @ A @ hayati
    return T @ arm.dh_T_flange.matrix()


def test_forward_is_the_product_of_eq_2(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(0)
    for arm in (*arms, odd_arm):
        q = rng.uniform(-3, 3, (50, arm.n))
        expected = np.array([eq_2(arm, row) for row in q])
        np.testing.assert_allclose(forward_kinematics(arm, q), expected, rtol=0, atol=1e-14)


def test_points_are_forward_applied_to_flange_points(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(1)
    for arm in (*arms, odd_arm):
        q, p = rng.uniform(-3, 3, (50, arm.n)), rng.uniform(-0.2, 0.2, (50, 3))
        T = forward_kinematics(arm, q)
        expected = np.einsum('nij,nj->ni', T[:, :3, :3], p) + T[:, :3, 3]
        np.testing.assert_allclose(points(arm, q, p), expected, rtol=0, atol=1e-14)
        one = points(arm, q, p[0])
        np.testing.assert_allclose(one, T[:, :3, :3] @ p[0] + T[:, :3, 3], rtol=0, atol=1e-14)


def test_points_are_the_same_by_what_the_joints_have_moved(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(2)
    railed = replace(
        odd_arm, joints=(replace(odd_arm.joints[0], type='prismatic'), *odd_arm.joints[1:])
    )
    for arm in (*arms, odd_arm, railed):
        q, p = rng.uniform(-3, 3, (50, arm.n)), rng.uniform(-0.2, 0.2, (50, 3))
        moved = (arm.direction * arm.uncoupled(q)).T
        turned = np.where(arm.prismatic[:, None], 0.0, moved)
        found = points_of_turned(arm, np.cos(turned), np.sin(turned), moved[arm.prismatic], p)
        np.testing.assert_allclose(found, points(arm, q, p), rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ('degrees', 'flange'),
    [((0, 0, 0, 0, 0, 0), (0.450, 0, 0.695)), ((0, 90, -90, 0, 0, 0), (0.720, 0, 0.425))],
)
def test_kr5_flange_is_where_its_maker_puts_it(
    kr5: Arm, degrees: tuple[float, ...], flange: tuple[float, ...]
) -> None:
    T = forward_kinematics(kr5, np.radians([degrees]))[0]
    np.testing.assert_allclose(T[:3, 3], flange, rtol=0, atol=1e-12)


def test_kr5_limits_are_kukas_axis_limits_in_the_joint_variable(kr5: Arm) -> None:
    axes = np.array([[-170, 170], [-190, 45], [-119, 165], [-190, 190], [-120, 120], [-358, 358]])
    shift = np.array([[0], [90], [-90], [0], [0], [0]])
    np.testing.assert_allclose(np.degrees(kr5.limits), axes + shift, atol=1e-9)


def test_a_posture_of_another_arm_is_refused(kr5: Arm) -> None:
    with pytest.raises(DataError, match='kuka_kr5_sixx_r650: expected 6 joint positions, got 7'):
        forward_kinematics(kr5, np.zeros((3, 7)))


def test_limits_hold_for_whole_postures_and_keep_the_margin(kr5: Arm) -> None:
    inside = kr5.limits.mean(axis=1)
    at_edge = inside.copy()
    at_edge[2] = kr5.limits[2, 1] - 0.05
    outside = inside.copy()
    outside[4] = kr5.limits[4, 0] - 1e-6
    q = np.array([inside, at_edge, outside])
    assert kr5.within_limits(q).tolist() == [True, True, False]
    assert kr5.within_limits(q, margin=0.1).tolist() == [True, False, False]
