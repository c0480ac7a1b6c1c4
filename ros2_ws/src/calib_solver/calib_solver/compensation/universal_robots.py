# SPDX-License-Identifier: Apache-2.0
"""A calibration as Universal Robots' ROS driver takes it: `kinematics_params_file`.

The driver's URDF has a link frame on each axis, z along it, and between two of them one fixed
transform. Where on its axis a frame lies is free: here it is where the driver's own files have it,
so that the meshes fit.
"""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_model.descriptions import yaml_text
from calib_model.errors import CalibrationError, DataError
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics, joint_frames
from calib_model.transforms import rotation_matrix
from calib_model.urdf import of_rpy, rpy

LINKS = ('shoulder', 'upper_arm', 'forearm', 'wrist_1', 'wrist_2', 'wrist_3')
KEYS = ('x', 'y', 'z', 'roll', 'pitch', 'yaw')
#: the driver's URDF turns `base_link` by half a turn before the first transform
TURNED, AS_IS = 'base_link', ('base', 'base_link_inertia')
EXACT = 1e-9  # m and rad
DUST = 1e-15  # m and rad: left by rounding
POSTURES = 50


def link_transforms(arm: Arm) -> Array:
    """The six transforms (6, 4, 4), m: T_base_flange = B M_1 Rz(q_1) .. M_6 Rz(q_6), where B is
    half a turn about z if the arm's base frame is `base_link`, else nothing.

    Raises:
        DataError: the driver's form has no place for such an arm.
    """
    if arm.n != len(LINKS) or arm.prismatic.any() or arm.coupling is not None:
        raise DataError(f'{arm.name}: expected six joints that turn, each by itself, as a UR has')
    before = np.linalg.inv(_base(arm))
    zero = np.zeros((1, arm.n))
    frames = list(joint_frames(arm, zero))
    points = [before[:3, :3] @ f.origin_joint[0] + before[:3, 3] for f in frames]
    along = [
        before[:3, :3] @ (direction * f.z_joint[0])
        for direction, f in zip(arm.direction, frames, strict=True)
    ]
    flange = before @ forward_kinematics(arm, zero)[0]
    origins = _origins(arm, points, along)
    placed = [_frame(origin, z) for origin, z in zip(origins, along[:5], strict=True)]
    away = flange[:3, 3] - points[5]
    beside = np.linalg.norm(away - away @ along[5] * along[5])
    if beside > EXACT or np.linalg.norm(flange[:3, 2] - along[5]) > EXACT:
        raise DataError(
            f'{arm.name}: expected {arm.flange_frame} on the last axis, z along it: the driver '
            'has no place for another flange'
        )
    placed.append(flange)
    steps = [np.linalg.inv(one) @ other for one, other in zip(placed, placed[1:], strict=False)]
    return np.array([placed[0], *steps])


def driver_yaml(arm: Arm, checksum: str = '') -> str:
    """The text of the driver's file, held against the arm's forward kinematics.

    `checksum` is what the driver compares with the robot's own; of none given one of these numbers
    is made, and the driver says that it is not the robot's.

    Raises:
        DataError: the driver's form has no place for such an arm.
        CalibrationError: the transforms written are off the arm.
    """
    rows: dict[str, Any] = {}
    for name, transform in zip(LINKS, link_transforms(arm), strict=True):
        values = np.concatenate([transform[:3, 3], rpy(transform[:3, :3])])
        values = np.where(np.abs(values) < DUST, 0.0, values)
        rows[name] = dict(zip(KEYS, map(float, values), strict=True))
    off = largest_difference(arm, rows)
    if not off < EXACT:
        raise CalibrationError(f"{arm.name}: the driver's transforms are {off:.2g} m off the arm")
    digest = hashlib.sha256(yaml_text(rows).encode()).digest()
    rows['hash'] = checksum or f'calib_{int.from_bytes(digest[:8], "big")}'
    return yaml_text({'kinematics': rows})


def largest_difference(arm: Arm, rows: dict[str, Any]) -> float:
    """By how much the flange of the driver's URDF and of the arm differ: any element, m."""
    q = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSTURES, arm.n))
    poses = np.broadcast_to(_base(arm), (POSTURES, 4, 4))
    for name, turns in zip(LINKS, q.T, strict=True):
        x, y, z, *angles = (rows[name][key] for key in KEYS)
        step = np.eye(4)
        step[:3, 3], step[:3, :3] = (x, y, z), of_rpy(np.array(angles))
        turned = np.tile(np.eye(4), (POSTURES, 1, 1))
        turned[:, :3, :3] = [rotation_matrix(np.array([0.0, 0.0, turn])) for turn in turns]
        poses = poses @ step @ turned
    return float(np.abs(poses - forward_kinematics(arm, q)).max())


def _base(arm: Arm) -> Array:
    """From the arm's base frame to that before the driver's first transform (4, 4)."""
    if arm.base_frame == TURNED:
        return np.diag([-1.0, -1.0, 1.0, 1.0])
    if arm.base_frame in AS_IS:
        return np.eye(4)
    known = ', '.join((TURNED, *AS_IS))
    raise DataError(
        f"{arm.name}: base frame {arm.base_frame!r}: expected one of the driver's, {known}"
    )


def _origins(arm: Arm, points: list[Array], along: list[Array]) -> list[Array]:
    """Where on axes 1 to 5 the driver's frames lie: shoulder and upper arm where these axes are
    nearest to one another, the forearm beside the upper arm, wrists nearest to the next axis."""

    def nearest(i: int, j: int) -> Array:
        """The point of axis i nearest to axis j."""
        across = np.cross(along[i], along[j])
        if np.linalg.norm(across) < 0.1:
            raise DataError(f'{arm.name}: axes {i + 1} and {j + 1} are parallel, those of a UR not')
        normal = np.cross(along[j], across)
        reach = (points[j] - points[i]) @ normal / (along[i] @ normal)
        found: Array = points[i] + reach * along[i]
        return found

    upper_arm = nearest(1, 0)
    forearm = points[2] + (upper_arm - points[2]) @ along[2] * along[2]
    return [nearest(0, 1), upper_arm, forearm, nearest(3, 4), nearest(4, 5)]


def _frame(origin: Array, z: Array) -> Array:
    """The frame (4, 4) there with its z along z (3,) and its x as near the base's as it goes."""
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= max(float(np.linalg.norm(x)), 1e-300)
    frame = np.eye(4)
    frame[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    frame[:3, 3] = origin
    return frame
