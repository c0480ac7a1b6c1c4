# SPDX-License-Identifier: Apache-2.0
"""Every analytic derivative of calib_model against finite differences, in one place."""

import numpy as np
from finite_differences import differences

from calib_model.instruments import Arm
from calib_model.kinematics.forward import forward_kinematics, point_derivatives, points
from calib_model.kinematics.jacobian import tool_motion, turning_jacobian
from calib_model.transforms import (
    RigidTransform,
    left_jacobian,
    rotation_matrix,
    rotation_vectors,
)


def test_point_derivatives(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for arm in (*arms, odd_arm):
        # away from beta = 0 as well: the shipped arms have none
        arm = arm.with_geometry(arm.geometry + rng.normal(0, 0.01, arm.geometry.shape))
        q, p_flange = rng.uniform(-3, 3, (6, arm.n)), rng.uniform(-0.2, 0.2, 3)
        found = point_derivatives(arm, q, p_flange)
        np.testing.assert_allclose(found.p_base, points(arm, q, p_flange), atol=1e-14)

        by_geometry = differences(
            lambda g, arm=arm, q=q, p=p_flange: points(arm.with_geometry(g), q, p), arm.geometry
        )
        np.testing.assert_allclose(found.geometry, by_geometry, rtol=0, atol=2e-11)
        by_flange = differences(lambda p, arm=arm, q=q: points(arm, q, p), p_flange)
        np.testing.assert_allclose(found.flange, by_flange, rtol=0, atol=2e-11)
        for row in range(len(q)):
            by_joints = differences(
                lambda x, arm=arm, p=p_flange: points(arm, x[None], p)[0], q[row]
            )
            np.testing.assert_allclose(found.joints[row], by_joints, rtol=0, atol=2e-11)


def test_a_point_of_its_own_for_every_posture(odd_arm: Arm) -> None:
    rng = np.random.default_rng(3)
    q, p = rng.uniform(-3, 3, (5, odd_arm.n)), rng.uniform(-0.2, 0.2, (5, 3))
    together = point_derivatives(odd_arm, q, p)
    for row in range(5):
        alone = point_derivatives(odd_arm, q[row : row + 1], p[row])
        np.testing.assert_allclose(together.geometry[row], alone.geometry[0], atol=1e-15)
        np.testing.assert_allclose(together.joints[row], alone.joints[0], atol=1e-15)


def test_tool_motion(odd_arm: Arm) -> None:
    rng = np.random.default_rng(5)
    q = rng.uniform(-3, 3, (3, odd_arm.n))
    tool = RigidTransform(*rng.uniform(-0.3, 0.3, (2, 3)))
    found = tool_motion(odd_arm, q, tool)
    for row in range(len(q)):

        def pose(x: np.ndarray) -> np.ndarray:
            there = tool_motion(odd_arm, x[None], tool)
            return np.concatenate([there.position[0], there.rotation[0].reshape(-1)])

        moved = differences(pose, q[row])
        np.testing.assert_allclose(found.jacobian[row, :3], moved[:3], rtol=0, atol=2e-11)
        spin = np.einsum('abj,cb->acj', moved[3:].reshape(3, 3, -1), found.rotation[row])
        turned = np.stack([spin[2, 1], spin[0, 2], spin[1, 0]])
        np.testing.assert_allclose(found.jacobian[row, 3:], turned, rtol=0, atol=2e-11)


def test_rotation_vector_jacobian() -> None:
    rng = np.random.default_rng(4)
    for size in (0.0, 1e-6, 5e-3, 0.3, 2.0, 3.1):
        axis = rng.normal(size=3)
        r, v = size * axis / np.linalg.norm(axis), rng.normal(size=3)
        expected = differences(lambda x, v=v: rotation_matrix(x) @ v, r)
        turned = rotation_matrix(r) @ v
        cross = np.cross(np.eye(3), turned)  # rows e_i x w, so its transpose is -[w]_x e_i
        found = cross.T @ left_jacobian(r)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def test_the_flange_turns_as_the_turning_jacobian_says(odd_arm):
    q = np.random.default_rng(6).uniform(-2, 2, (4, odd_arm.n))
    slope = turning_jacobian(odd_arm, q)
    values = odd_arm.geometry.reshape(-1)
    size = 1e-6
    for column in range(len(values)):
        step = np.zeros(len(values))
        step[column] = size
        ahead, behind = (
            forward_kinematics(odd_arm.with_geometry(np.reshape(values + s, (5, -1))), q)
            for s in (step, -step)
        )
        turned = ahead[:, :3, :3] @ np.swapaxes(behind[:, :3, :3], 1, 2)
        np.testing.assert_allclose(
            rotation_vectors(turned) / (2 * size), slope[:, :, column], atol=1e-8
        )
