# SPDX-License-Identifier: Apache-2.0
"""Postures of an arm that hold a point of its flange on a point of the room."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import joint_frames
from calib_model.transforms import cross

EXACT = 1e-12  # m
LARGEST_STEP = 0.5  # rad, of all joints together: Newton from far away overshoots
DAMPING = 1e-12  # m^2: keeps a stretched arm's step finite, too small to be felt elsewhere


@dataclass(frozen=True)
class Reach:
    """Where N postures bring a point of the flange.

    `p_base` (N, 3), m; `jacobian` (N, 3, n), m/rad, by the joint positions; `rotation`
    (N, 3, 3) of the flange.
    """

    p_base: Array
    jacobian: Array
    rotation: Array


def reach(arm: Arm, q: Array, p_flange: Array) -> Reach:
    """Where postures q (N, n) bring points `p_flange` (3,) or (N, 3), m.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    frames = list(joint_frames(arm, q))
    last = frames[-1]
    p_last = arm.dh_T_flange.apply(np.broadcast_to(p_flange, last.origin.shape))
    p_base = last.origin + np.einsum('nij,nj->ni', last.rotation, p_last)
    jacobian = np.empty((*p_base.shape, arm.n))
    for i, frame in enumerate(frames):
        jacobian[:, :, i] = cross(frame.z_joint, p_base - frame.origin_joint)
    rotation = last.rotation @ arm.dh_T_flange.rotation
    return Reach(p_base, jacobian * arm.direction, rotation)


def seated(
    arm: Arm, q: Array, p_flange: Array, p_base: Array, iterations: int = 30
) -> tuple[Array, NDArray[np.bool_]]:
    """The postures (N, n) nearest to q (N, n) with `p_flange` on `p_base`, and which are there.

    `p_flange` and `p_base` are (3,) or (N, 3), m. Newton's steps are the shortest ones in the
    joints, so that a smooth motion q stays smooth. Limits are not applied.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    q = np.array(arm.check_joints(q))
    p_flange = np.broadcast_to(p_flange, (len(q), 3))
    p_base = np.broadcast_to(p_base, (len(q), 3))
    off = np.arange(len(q))
    for _ in range(iterations):
        now = reach(arm, q[off], p_flange[off])
        miss = p_base[off] - now.p_base
        still = np.linalg.norm(miss, axis=1) > EXACT
        off = off[still]
        if not len(off):
            break
        q[off] += _step(now.jacobian[still], miss[still])
    there = np.ones(len(q), dtype=bool)
    there[off] = False
    return q, there


def _step(jacobian: Array, miss: Array) -> Array:
    """The shortest joint steps (N, n) that close a miss (N, 3), none longer than allowed."""
    square = jacobian @ jacobian.transpose(0, 2, 1) + DAMPING * np.eye(3)
    step = np.einsum('nki,nk->ni', jacobian, np.linalg.solve(square, miss[:, :, None])[:, :, 0])
    length = np.linalg.norm(step, axis=1, keepdims=True)
    shortened: Array = step * np.minimum(1.0, LARGEST_STEP / np.maximum(length, LARGEST_STEP))
    return shortened
