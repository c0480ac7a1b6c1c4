# SPDX-License-Identifier: Apache-2.0
"""Craig's modified Denavit-Hartenberg parameters as the classic ones that all else here is in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib_model.instruments import Joint
from calib_model.transforms import RigidTransform, rotation_matrix


def classic_of_modified(
    joints: Sequence[Joint], base_T_dh: RigidTransform
) -> tuple[tuple[Joint, ...], RigidTransform]:
    """The same chain in classic parameters: its joints, and what stands before the first.

    A modified row is Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d), a classic one Tz(d) Rz(theta) Tx(a)
    Rx(alpha) Ry(beta): a, alpha and beta of each row belong to the joint before, those of the first
    row to the base, and the last joint has none.
    """
    following = [(row.a, row.alpha, row.beta) for row in joints[1:]] + [(0.0, 0.0, 0.0)]
    shifted = tuple(
        replace(joint, a=a, alpha=alpha, beta=beta)
        for joint, (a, alpha, beta) in zip(joints, following, strict=True)
    )
    first = joints[0]
    if not (first.a or first.alpha or first.beta):
        return shifted, base_T_dh
    step = np.eye(4)
    step[0, 3] = first.a
    tilt = rotation_matrix(np.array([first.alpha, 0.0, 0.0]))
    step[:3, :3] = tilt @ rotation_matrix(np.array([0.0, first.beta, 0.0]))
    return shifted, RigidTransform.from_matrix(base_T_dh.matrix() @ step)
