# SPDX-License-Identifier: Apache-2.0
"""Joints that mirror the arm when all of them are counted the other way.

Those are the joints whose axes lie in the plane of symmetry that the arm has with all joints at
zero. A gauge looks the same in a mirror, so its distances do not tell one from the other.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics, points

POSTURES = 24
#: points that are apart by less than this part of the arm's reach are the same
ALIKE = 1e-6
#: with more joints than this nobody asks, and there are too many ways
MOST_JOINTS = 8


def mirroring_joints(arm: Arm) -> tuple[int, ...]:
    """Numbers, from 0, of the joints of a nominal arm that mirror it; () where there are none."""
    if arm.n > MOST_JOINTS:
        return ()
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (POSTURES, arm.n))
    signs = sorted(product((1.0, -1.0), repeat=arm.n), key=lambda one: -sum(one))
    # points on the flange's axis show the mirror, whatever the last joint does
    mirror = next(filter(None, (_mirror(arm, q, np.array(one)) for one in signs[1:])), None)
    if mirror is None:
        return ()
    # a tool beside that axis, and the same tool in the mirror
    (T,) = forward_kinematics(arm, np.zeros((1, arm.n)))
    tool = np.array([0.05, 0.08, 0.1])
    normal, offset = mirror
    there = T[:3, :3] @ tool + T[:3, 3]
    tool_mirrored = T[:3, :3].T @ (_reflected(there, normal, offset) - T[:3, 3])
    wanted = _reflected(points(arm, q, tool), normal, offset)
    for one in signs[1:]:
        off = points(arm, np.array(one) * q, tool_mirrored) - wanted
        if np.abs(off).max() < ALIKE * np.abs(wanted).max():
            return tuple(int(joint) for joint in np.flatnonzero(np.array(one) < 0))
    return ()


def _mirror(arm: Arm, q: Array, signs: Array) -> tuple[Array, float] | None:
    """The plane, by unit normal (3,) and offset (m), that takes points on the flange's axis to
    where they are with joints q (N, n) of other signs (n,); None where there is none."""
    one, other = _on_axis(arm, q), _on_axis(arm, signs * q)
    between = other - one
    apart = np.linalg.norm(between, axis=1)
    size = float(np.abs(one).max())
    if apart.max() < ALIKE * size:
        return None
    normal = between[apart.argmax()] / apart.max()
    offset = float(normal @ (one + other)[apart.argmax()]) / 2
    off = _reflected(one, normal, offset) - other
    return (normal, offset) if np.abs(off).max() < ALIKE * size else None


def _on_axis(arm: Arm, q: Array) -> Array:
    """Two points of the flange's axis at each posture, (2 N, 3), m."""
    return np.concatenate([points(arm, q, np.array([0.0, 0.0, along])) for along in (0.0, 0.1)])


def _reflected(p: Array, normal: Array, offset: float) -> Array:
    """Points (..., 3) in the mirror."""
    reflected: Array = p - 2 * np.multiply.outer(p @ normal - offset, normal)
    return reflected
