# SPDX-License-Identifier: Apache-2.0
"""The arm as a Pinocchio model, made from its Denavit-Hartenberg description."""

from __future__ import annotations

import numpy as np
import pinocchio

from calib_model.arrays import Array
from calib_model.instruments import Arm, Joint


class PinocchioArm:
    """One joint about or along z (or -z) per row of the description, the flange as a frame.

    A_i = Tz(d) Rz(theta) Tx(a) Rx(alpha) Ry(beta) is split at the joint: what moves with q is
    Rz(direction * q) or Tz(direction * q), everything after it is the constant placement of the
    next joint. Of a coupled arm the model's joints are at `configuration(q)`.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self.model = pinocchio.Model()
        self.model.name = arm.name
        parent, placement = 0, pinocchio.SE3(arm.base_T_dh.matrix())
        for joint in arm.joints:
            parent = self._add_joint(joint, parent, placement)
            placement = _after_joint(joint)
        placement = placement * pinocchio.SE3(arm.dh_T_flange.matrix())
        flange = pinocchio.Frame(arm.flange_frame, parent, placement, pinocchio.FrameType.OP_FRAME)
        self.flange_frame = self.model.addFrame(flange)
        self.data = self.model.createData()

    def _add_joint(self, joint: Joint, parent: int, placement: pinocchio.SE3) -> int:
        axis = np.array([0.0, 0.0, float(joint.direction)])
        lower, upper = joint.limits
        kind = (
            pinocchio.JointModelPrismaticUnaligned
            if joint.prismatic
            else pinocchio.JointModelRevoluteUnaligned
        )
        index: int = self.model.addJoint(
            parent,
            kind(axis),
            placement,
            joint.name,
            np.array([np.inf]),
            np.array([joint.velocity]),
            np.array([lower]),
            np.array([upper]),
        )
        return index

    def configuration(self, q: Array) -> Array:
        """Where the model's joints are (n,) in a posture q (n,)."""
        # asked for thousands of times a plan
        return q if self.arm.coupling is None else self.arm.uncoupled(q)[0]

    def flange_pose(self, q: Array) -> Array:
        """`T_base_flange` (4, 4) of one posture q (n,), m."""
        pinocchio.framesForwardKinematics(self.model, self.data, self.configuration(q))
        pose: Array = self.data.oMf[self.flange_frame].homogeneous.copy()
        return pose

    def flange_jacobian(self, q: Array) -> Array:
        """The flange's velocity (6, n) per joint speed, axes of the base: linear, then angular."""
        jacobian: Array = pinocchio.computeFrameJacobian(
            self.model,
            self.data,
            self.configuration(q),
            self.flange_frame,
            pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED,
        )
        return self.arm.by_positions(jacobian)


def _after_joint(joint: Joint) -> pinocchio.SE3:
    """What follows the turning part: Rz(-theta_0) Tz(d) Tx(a) Rx(alpha) Ry(beta)."""
    turned = pinocchio.SE3(pinocchio.utils.rotate('z', -joint.theta_0), np.zeros(3))
    moved = pinocchio.SE3(np.eye(3), np.array([joint.a, 0.0, joint.d]))
    tilted = pinocchio.utils.rotate('x', joint.alpha) @ pinocchio.utils.rotate('y', joint.beta)
    return turned * moved * pinocchio.SE3(tilted, np.zeros(3))
