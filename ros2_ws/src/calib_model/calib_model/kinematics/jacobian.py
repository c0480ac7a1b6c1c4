# SPDX-License-Identifier: Apache-2.0
"""How a probed sphere's centre moves with every parameter, and a tool with the joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import JOINT_PARAMETERS, Arm, Probe
from calib_model.kinematics.forward import joint_frames, point_derivatives
from calib_model.transforms import RigidTransform, cross, left_jacobian, skew


def probing_jacobian(
    arm: Arm, probe: Probe, joints: Array, p_probe_sphere: Array
) -> tuple[Array, Array]:
    """`p_base_sphere` (N, 3), m, and its Jacobian (N, 3, 5n + 6) in the table's column order.

    For postures `joints` (N, n) that have the sphere's centre at `p_probe_sphere` (N, 3).
    """
    mount = probe.flange_T_probe
    turned = p_probe_sphere @ mount.rotation.T
    derivatives = point_derivatives(arm, joints, turned + mount.translation)
    by_rotation = -skew(turned) @ left_jacobian(mount.rotation_vector)
    jacobian = np.concatenate(
        [
            derivatives.geometry.reshape(len(turned), 3, len(JOINT_PARAMETERS) * arm.n),
            derivatives.flange,
            derivatives.flange @ by_rotation,
        ],
        axis=2,
    )
    return derivatives.p_base, jacobian


@dataclass(frozen=True)
class ToolMotion:
    """Where a tool is in N postures and how it moves with the joints, all in the base frame.

    `position` (N, 3), m; `rotation` (N, 3, 3); `jacobian` (N, 6, n): the linear velocity of its
    origin, m/rad or m/m, above its angular velocity, rad/rad or rad/m.
    """

    position: Array
    rotation: Array
    jacobian: Array


def tool_motion(arm: Arm, q: Array, flange_T_tool: RigidTransform) -> ToolMotion:
    """The pose of a tool on the flange in postures q (N, n), and its geometric Jacobian.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    T_last_tool = arm.dh_T_flange.matrix() @ flange_T_tool.matrix()
    frames = list(joint_frames(arm, q))
    last = frames[-1]
    position = last.origin + last.rotation @ T_last_tool[:3, 3]
    jacobian = np.empty((len(position), 6, arm.n))
    for i, frame in enumerate(frames):
        axis = arm.direction[i] * frame.z_joint
        if arm.prismatic[i]:
            jacobian[:, :3, i], jacobian[:, 3:, i] = axis, 0.0
            continue
        jacobian[:, :3, i] = cross(axis, position - frame.origin_joint)
        jacobian[:, 3:, i] = axis
    by_positions = arm.by_positions(jacobian)
    return ToolMotion(position, last.rotation @ T_last_tool[:3, :3], by_positions)


def turning_jacobian(arm: Arm, q: Array) -> Array:
    """How the flange turns, in the base frame, with a, alpha, d, theta_0, beta of every joint.

    For postures q (N, n), rad; shape (N, 3, 5n) in the table's column order, rad/rad. Lengths turn
    nothing.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    turned = np.zeros((len(q), 3, len(JOINT_PARAMETERS), arm.n))
    of = {key: JOINT_PARAMETERS.index(key) for key in ('alpha', 'theta_0', 'beta')}
    for i, frame in enumerate(joint_frames(arm, q)):
        turned[:, :, of['alpha'], i] = frame.x
        turned[:, :, of['theta_0'], i] = -frame.z_joint
        turned[:, :, of['beta'], i] = frame.rotation[:, :, 1]
    return turned.reshape(len(q), 3, len(JOINT_PARAMETERS) * arm.n)
