# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics (eqs. 2 to 4, 9) and its analytic derivatives, vectorised over poses.

The arm's `base_T_dh` and `dh_T_flange` stand before the first and behind the last matrix.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import JOINT_PARAMETERS, Arm
from calib_model.transforms import cross

BLOCK = 2048  # poses at a time: what is in between stays in cache


@dataclass(frozen=True)
class JointFrame:
    """What one joint's transformation leaves behind for N poses, all in the base frame.

    `z_joint` (N, 3) is the joint's axis through `origin_joint` (N, 3); `x` (N, 3) the common
    normal; `rotation` (N, 3, 3) and `origin` (N, 3) the frame after the joint.
    """

    origin_joint: Array
    z_joint: Array
    x: Array
    rotation: Array
    origin: Array


def joint_frames(arm: Arm, q: Array) -> Iterator[JointFrame]:
    """The frames of eq. 2, joint by joint from the base, for postures q (N, n)."""
    for before, z_joint, x, axes, after in _passed_through(arm, q):
        rotation = np.array(axes).transpose(2, 1, 0)
        if before.shape != after.shape:  # the first joint's
            before, z_joint = (np.broadcast_to(each, after.shape) for each in (before, z_joint))
        yield JointFrame(before.T, z_joint.T, x.T, rotation, after.T)


def _passed_through(
    arm: Arm, q: Array
) -> Iterator[tuple[Array, Array, Array, tuple[Array, ...], Array]]:
    """Of each joint its origin, its axis and the common normal, then the axes x, y, z and the
    origin of the frame behind it, all (3, N): what is done to all poses at once lies side by side.
    Of the first joint, which is where it is in all postures, origin and axis are (3, 1)."""
    turns, slides = _turns_and_slides(arm, q)
    a, alpha, _, _, beta = arm.geometry
    tilts = zip(np.cos(alpha).tolist(), np.sin(alpha).tolist(), strict=True)
    bends = zip(np.cos(beta).tolist(), np.sin(beta).tolist(), strict=True)
    x_before, y_before, z_before = arm.base_T_dh.rotation.T[:, :, None]
    origin = arm.base_T_dh.translation[:, None]
    for cosine, sine, slide, length, (cos_alpha, sin_alpha), (cos_beta, sin_beta) in zip(
        np.cos(turns), np.sin(turns), slides, a.tolist(), tilts, bends, strict=True
    ):
        x = cosine * x_before + sine * y_before
        y_turned = cosine * y_before - sine * x_before
        y = cos_alpha * y_turned + sin_alpha * z_before
        z = cos_alpha * z_before - sin_alpha * y_turned
        axes = (x, y, z)
        if sin_beta != 0.0:
            axes = (cos_beta * x - sin_beta * z, y, sin_beta * x + cos_beta * z)
        after = origin + slide * z_before + length * x
        yield origin, z_before, x, axes, after
        (x_before, y_before, z_before), origin = axes, after


def _turns_and_slides(arm: Arm, q: Array) -> tuple[Array, Array]:
    """By what each joint turns (n, N), rad, and slides (n, N), m, in postures q (N, n)."""
    moved = (arm.direction * arm.uncoupled(q)).T
    d, theta_0 = arm.geometry[2:4, :, None]
    slides_only = arm.prismatic[:, None]
    if not slides_only.any():
        return moved - theta_0, np.broadcast_to(d, moved.shape)
    return np.where(slides_only, 0.0, moved) - theta_0, np.where(slides_only, moved, 0.0) + d


def forward_kinematics(arm: Arm, q: Array) -> Array:
    """`T_base_flange` (N, 4, 4) of postures q (N, n): eq. 3 without the probe.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    q = arm.check_joints(q)
    matrices = np.zeros((len(q), 4, 4))
    matrices[:, 3, 3] = 1.0
    flange = arm.dh_T_flange
    for first in range(0, len(q), BLOCK):
        block = slice(first, first + BLOCK)
        *_, (_, _, _, axes, after) = _passed_through(arm, q[block])
        rotation, origin = np.array(axes).transpose(2, 1, 0), after.T
        if flange.is_identity:
            matrices[block, :3, :3], matrices[block, :3, 3] = rotation, origin
        else:
            matrices[block, :3, :3] = rotation @ flange.rotation
            matrices[block, :3, 3] = origin + rotation @ flange.translation
    return matrices


def points(arm: Arm, q: Array, p_flange: Array) -> Array:
    """`p_base` (N, 3) of points `p_flange` (3,) or (N, 3) fixed to the flange, m: eq. 9.

    Applies the joints from the flange to the base, so no matrices are built.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    turns, slides = _turns_and_slides(arm, q)
    cosine, sine = np.cos(turns), np.sin(turns)
    return _carried(arm, lambda i: (cosine[i], sine[i], slides[i]), len(q), p_flange)


def points_of_turned(arm: Arm, cosine: Array, sine: Array, slide: Array, p_flange: Array) -> Array:
    """The same by what the joints have moved, theta_0 and d apart: `cosine` and `sine` (n, N) of
    what each has turned, and `slide` (P, N), m, of the P prismatic ones, which have not turned.

    These stay while the D-H parameters are sought.
    """
    d, theta_0 = arm.geometry[2:4]
    moved = dict(zip(np.flatnonzero(arm.prismatic).tolist(), slide, strict=True))

    def joint(i: int) -> tuple[Array, Array, Array]:
        cos_zero, sin_zero = np.cos(theta_0[i]), np.sin(theta_0[i])
        turned = (
            cos_zero * cosine[i] + sin_zero * sine[i],
            cos_zero * sine[i] - sin_zero * cosine[i],
        )
        return *turned, d[i] + moved.get(i, 0.0)

    return _carried(arm, joint, cosine.shape[1], p_flange)


def _carried(
    arm: Arm, joint: Callable[[int], tuple[Array, Array, Array]], count: int, p_flange: Array
) -> Array:
    """Points of the flange in the base frame (N, 3), by the cosine and sine of what a joint turns
    and by what it slides (N,), m. One joint at a time, as all of them are more than a cache holds.
    """
    x, y, z = _in_last_frame(arm, p_flange, count).T
    for i in reversed(range(arm.n)):
        a, alpha, _, _, beta = arm.geometry[:, i]
        if beta != 0.0:
            x, z = np.cos(beta) * x + np.sin(beta) * z, np.cos(beta) * z - np.sin(beta) * x
        y, z = np.cos(alpha) * y - np.sin(alpha) * z, np.sin(alpha) * y + np.cos(alpha) * z
        cosine, sine, slide = joint(i)
        x, z = x + a, z + slide
        x, y = cosine * x - sine * y, sine * x + cosine * y
    p_dh = np.stack([x, y, z], axis=-1)
    return p_dh if arm.base_T_dh.is_identity else arm.base_T_dh.apply(p_dh)


def _in_last_frame(arm: Arm, p_flange: Array, count: int) -> Array:
    """Points of the flange in the frame of the last D-H matrix, shape (count, 3)."""
    p = np.broadcast_to(p_flange, (count, 3))
    return p if arm.dh_T_flange.is_identity else arm.dh_T_flange.apply(p)


@dataclass(frozen=True)
class PointDerivatives:
    """Points `p_base` (N, 3) and how they move.

    `geometry` (N, 3, 5, n): by each joint's a, alpha, d, theta_0, beta (the order of
    `JOINT_PARAMETERS`), m/m and m/rad. `joints` (N, 3, n): by the joint positions, m/rad, m/m.
    `flange` (N, 3, 3): the flange's rotation, the derivative by `p_flange`.
    """

    p_base: Array
    geometry: Array
    joints: Array
    flange: Array


def point_derivatives(arm: Arm, q: Array, p_flange: Array) -> PointDerivatives:
    """The analytic Jacobian of `points` by every parameter and every joint.

    Each parameter is a screw: a length moves the point along its axis, an angle turns it about
    its axis; the axes are those of the frames that eq. 2 passes through.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    q = arm.check_joints(q)
    frames = list(joint_frames(arm, q))
    last = frames[-1].rotation
    lever = np.einsum('nij,nj->ni', last, _in_last_frame(arm, p_flange, len(q)))
    p_base = frames[-1].origin + lever
    geometry = np.empty((len(q), 3, len(JOINT_PARAMETERS), arm.n))
    joints = np.empty((len(q), 3, arm.n))
    for i, frame in enumerate(frames):
        turned = cross(frame.z_joint, p_base - frame.origin_joint)
        from_origin = p_base - frame.origin
        geometry[:, :, 0, i] = frame.x
        geometry[:, :, 1, i] = cross(frame.x, from_origin)
        geometry[:, :, 2, i] = frame.z_joint
        geometry[:, :, 3, i] = -turned
        geometry[:, :, 4, i] = cross(frame.rotation[:, :, 1], from_origin)
        joints[:, :, i] = arm.direction[i] * (frame.z_joint if arm.prismatic[i] else turned)
    by_positions = arm.by_positions(joints)
    return PointDerivatives(p_base, geometry, by_positions, last @ arm.dh_T_flange.rotation)
