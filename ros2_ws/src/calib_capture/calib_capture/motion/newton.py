# SPDX-License-Identifier: Apache-2.0
"""Newton's method on the flange pose: a posture that reaches it, from one that is near."""

from __future__ import annotations

import numpy as np
import pinocchio

from calib_capture.motion.pinocchio_arm import PinocchioArm
from calib_model.arrays import Array
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import forward_kinematics, joint_frames
from calib_model.transforms import cross

DAMPING = 1e-9  # keeps the step finite where the Jacobian is singular
LONGEST_STEP = 0.7  # rad: farther away the Jacobian says little
POSTURES = 4000  # of which the nearest ones are started from
STARTS = 6
EXACT, ITERATIONS = 1e-10, 20
HOPELESS, FAR = 8, 0.1  # after so many steps one that is as far (m, rad) will not come
TURNED = 0.15  # m


def reached(
    model: PinocchioArm, q: Array, T_base_flange: Array, exact: float, iterations: int
) -> Array | None:
    """The posture (n,) near q (n,) that has the flange at a pose (4, 4) to `exact` m and rad.

    None where it was not reached in so many steps. Of all steps the shortest is taken, where a
    redundant joint leaves several.
    """
    rotation, position = T_base_flange[:3, :3], T_base_flange[:3, 3]
    for _ in range(iterations):
        pose = model.flange_pose(q)
        turn = pinocchio.log3(rotation @ pose[:3, :3].T)
        off = np.concatenate([position - pose[:3, 3], turn])
        if np.abs(off).max() < exact:
            return q
        jacobian = model.flange_jacobian(q)
        damped = jacobian @ jacobian.T + DAMPING * np.eye(6)
        q = q + jacobian.T @ np.linalg.solve(damped, off)
    return None


class NewtonInverse:
    """Postures that reach poses, for arms without a closed form: from the nearest of many known
    postures by Newton's method. It finds several branches, seldom all of them."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        lower, upper = arm.ranges.T
        self._q = np.random.default_rng(0).uniform(lower, upper, (POSTURES, arm.n))
        self._known = _features(forward_kinematics(arm, self._q))

    def postures(self, T_base_flange: Array) -> list[Array]:
        """For each of the poses (H, 4, 4) the postures (K, n) that reach it; any full turns,
        limits not applied."""
        starts = [self._nearest(row) for row in _features(T_base_flange)]
        hand = np.repeat(np.arange(len(starts)), STARTS)
        q, done = self._reached(np.concatenate(starts), T_base_flange[hand])
        return [q[done & (hand == each)] for each in range(len(starts))]

    def _nearest(self, features: Array) -> Array:
        off = self._known - features
        square = np.einsum('nk,nk->n', off, off)
        nearest = np.argpartition(square, STARTS)[:STARTS]
        return self._q[np.sort(nearest)]

    def _reached(self, q: Array, goals: Array) -> tuple[Array, NDArrayBool]:
        """Postures (M, n) moved to their goals (M, 4, 4), and which of them got there."""
        q, done = q.copy(), np.zeros(len(q), dtype=bool)
        left = np.arange(len(q))
        for step in range(ITERATIONS):
            pose, jacobian = _flange(self._arm, q[left])
            off = _difference(goals[left], pose)
            far = np.abs(off).max(axis=1)
            done[left[far < EXACT]] = True
            going = (far >= EXACT) & ((far < FAR) | (step < HOPELESS))
            left, off, jacobian = left[going], off[going], jacobian[going]
            if not len(left):
                break
            damped = jacobian @ np.swapaxes(jacobian, 1, 2) + DAMPING * np.eye(6)
            change = np.linalg.solve(damped, off[:, :, None])
            moved = np.einsum('mkn,mk->mn', jacobian, change[:, :, 0])
            longest = np.maximum(np.abs(moved).max(axis=1, keepdims=True), LONGEST_STEP)
            q[left] += moved * (LONGEST_STEP / longest)
        return q, done


def _features(poses: Array) -> Array:
    """Poses (N, 4, 4) as rows (N, 12) whose distance says how far apart they are; turned axes
    count as if they were TURNED m long."""
    turned = TURNED * poses[:, :3, :3].reshape(-1, 9)
    return np.concatenate([poses[:, :3, 3], turned], axis=1)


def _flange(arm: Arm, q: Array) -> tuple[Array, Array]:
    """The flange's poses (M, 4, 4) and Jacobians (M, 6, n), linear then angular, in base axes."""
    frames = list(joint_frames(arm, q))
    last, flange = frames[-1], arm.dh_T_flange
    pose = np.zeros((len(q), 4, 4))
    pose[:, :3, :3] = last.rotation @ flange.rotation
    pose[:, :3, 3] = last.origin + last.rotation @ flange.translation
    axes = np.stack([frame.z_joint for frame in frames], axis=2) * arm.direction
    levers = pose[:, :3, 3, None] - np.stack([frame.origin_joint for frame in frames], axis=2)
    return pose, np.concatenate([cross(axes, levers), axes], axis=1)


def _difference(goal: Array, pose: Array) -> Array:
    """From poses (M, 4, 4) to their goals: translation and rotation vector (M, 6), base axes."""
    turn = goal[:, :3, :3] @ np.swapaxes(pose[:, :3, :3], 1, 2)
    sine_axis = 0.5 * np.stack(
        [
            turn[:, 2, 1] - turn[:, 1, 2],
            turn[:, 0, 2] - turn[:, 2, 0],
            turn[:, 1, 0] - turn[:, 0, 1],
        ],
        axis=1,
    )
    sine = np.linalg.norm(sine_axis, axis=1)
    angle = np.arctan2(sine, (np.einsum('mii->m', turn) - 1) / 2)
    scale = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return np.concatenate([goal[:, :3, 3] - pose[:, :3, 3], scale[:, None] * sine_axis], axis=1)
