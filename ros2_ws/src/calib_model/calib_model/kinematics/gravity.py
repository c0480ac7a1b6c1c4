# SPDX-License-Identifier: Apache-2.0
"""What the weight of an arm's links does to its joints, by way of Pinocchio."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm
from calib_model.kinematics.forward import JointFrame, joint_frames

STANDARD_GRAVITY = (0.0, 0.0, -9.80665)


@dataclass(frozen=True, eq=False)
class Links:
    """What the n links behind the joints weigh: `mass` (n,), kg, and `center` (n, 3), m, the
    centre of mass in the joint's D-H frame; `gravity` (3,), m/s^2, in the base frame."""

    mass: Array
    center: Array
    gravity: Array = field(default_factory=lambda: frozen(STANDARD_GRAVITY))

    def __post_init__(self) -> None:
        for name in ('mass', 'center', 'gravity'):
            object.__setattr__(self, name, frozen(getattr(self, name)))


def gravity_torques(arm: Arm, links: Links, q: Array) -> Array:
    """The torque (N, n), N m, with which gravity turns each joint at postures q (N, n), rad.

    Positive where it pulls towards larger q: less than nothing is what the motor holds. The force,
    N, on a joint that slides; the torque on the joint itself of one that is coupled.

    Raises:
        DataError: `q` has not the arm's number of joints.
    """
    # half a second of loading, for those alone who ask for compliance
    import pinocchio

    q = arm.check_joints(q)
    model = _model(arm, links, pinocchio)
    data = model.createData()
    moved = arm.uncoupled(q)
    held = [pinocchio.computeGeneralizedGravity(model, data, row).copy() for row in moved]
    torques: Array = -np.reshape(held, (len(q), arm.n))
    return torques


def _model(arm: Arm, links: Links, pinocchio: Any) -> Any:
    """The D-H arm with its links' masses; what they resist in turning plays no part."""
    model = pinocchio.Model()
    model.gravity.linear = np.array(links.gravity)
    parent, before = 0, pinocchio.SE3.Identity()
    for i, frame in enumerate(joint_frames(arm, np.zeros((1, arm.n)))):
        placed = pinocchio.SE3(*_joint_place(frame))
        axis = np.array([0.0, 0.0, float(arm.direction[i])])
        unaligned = (
            pinocchio.JointModelPrismaticUnaligned
            if arm.prismatic[i]
            else pinocchio.JointModelRevoluteUnaligned
        )
        parent = model.addJoint(
            parent,
            unaligned(axis),
            before.actInv(placed),
            arm.joints[i].name,
        )
        center = placed.actInv(frame.origin[0] + frame.rotation[0] @ links.center[i])
        body = pinocchio.Inertia(float(links.mass[i]), center, np.zeros((3, 3)))
        model.appendBodyToJoint(parent, body, pinocchio.SE3.Identity())
        before = placed
    return model


def _joint_place(frame: JointFrame) -> tuple[Array, Array]:
    """A frame on a joint's axis as it stands at q = 0: rotation (3, 3) and origin (3,)."""
    x, z = frame.x[0], frame.z_joint[0]
    return np.stack([x, np.cross(z, x), z], axis=1), np.array(frame.origin_joint[0])
