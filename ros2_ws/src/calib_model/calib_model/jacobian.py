# SPDX-License-Identifier: Apache-2.0
"""How a probed sphere's centre moves with every column of the parameter table."""

from __future__ import annotations

import numpy as np

from calib_model.arm import JOINT_PARAMETERS, Arm
from calib_model.kinematics import point_derivatives
from calib_model.probe import Probe
from calib_model.rotation import Array, left_jacobian, skew


def probing_jacobian(
    arm: Arm, probe: Probe, joints: Array, p_probe_sphere: Array
) -> tuple[Array, Array]:
    """`p_base_sphere` (N, 3), m, and its Jacobian (N, 3, 5n + 6) in the table's column order.

    For postures `joints` (N, n) in rad that have the sphere's centre at `p_probe_sphere` (N, 3).
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
