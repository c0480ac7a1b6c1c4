# SPDX-License-Identifier: Apache-2.0
"""Denavit-Hartenberg parameters of any serial chain, with Hayati's where axes are parallel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import PRISMATIC, REVOLUTE, Arm, Joint
from calib_model.kinematics import NEARLY_PARALLEL
from calib_model.transforms import RigidTransform, rotation_matrix
from calib_model.urdf.serial_chain import SerialChain

#: rad: an angle nearer than this to a right one is meant to be it; URDFs say 1.57079632679
ROUNDING = 1e-11
MEETING = 1e-11  # m: parallel axes nearer than this are one


@dataclass(frozen=True)
class Line:
    """A joint's axis in the base frame at q = 0: `point` (3,) on it, m, and `along` (3,)."""

    point: Array
    along: Array


@dataclass(frozen=True)
class Step:
    """One D-H matrix at q = 0: Tz(d) Rz(theta) Tx(a) Rx(alpha) Ry(beta), eq. 2."""

    a: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    beta: float = 0.0

    def matrix(self) -> Array:
        """The homogeneous matrix (4, 4)."""
        turned, placed = np.eye(4), np.eye(4)
        turned[:3, :3] = rotation_matrix(np.array([0.0, 0.0, self.theta]))
        turned[2, 3] = self.d
        tilt = rotation_matrix(np.array([self.alpha, 0.0, 0.0]))
        placed[:3, :3] = tilt @ rotation_matrix(np.array([0.0, self.beta, 0.0]))
        placed[0, 3] = self.a
        matrix: Array = turned @ placed
        return matrix


def arm_of_chain(chain: SerialChain, name: str = '') -> Arm:
    """The arm whose flange is where the chain puts it for every q, to rounding.

    Joint positions and zeros are the chain's. Where axes i and i + 1 are nearly parallel, d_i is
    zero and alpha_i, beta_i tilt them (Hayati); elsewhere a_i lies along their common normal.
    """
    lines, T_base_flange = _lines(chain)
    upwards = lines[0].along[2] > -ROUNDING
    first = lines[0] if upwards else Line(lines[0].point, -lines[0].along)
    base = _base(first)
    frame = base.matrix()
    steps = []
    for line in lines[1:]:
        steps.append(_to_axis(frame, line))
        frame = frame @ steps[-1].matrix()
    T_axis_flange = np.linalg.inv(frame) @ T_base_flange
    last, flange = _to_flange(T_axis_flange)
    joints = []
    for i, (joint, step) in enumerate(zip(chain.moving, [*steps, last], strict=True)):
        direction = -1 if i == 0 and not upwards else 1
        values = (step.a, step.alpha, step.d, _round_angle(-step.theta), step.beta)
        kind = PRISMATIC if joint.prismatic else REVOLUTE
        limits, velocity = joint.limits, joint.velocity
        joints.append(
            Joint(joint.name, *values, direction, limits=limits, velocity=velocity, type=kind)
        )
    return Arm(name or chain.robot, tuple(joints), chain.base, chain.flange, base, flange)


def _lines(chain: SerialChain) -> tuple[list[Line], Array]:
    """The moving joints' axes and the flange's pose at q = 0."""
    *before, last = chain.segments()
    matrix, lines = np.eye(4), []
    for segment, joint in zip(before, chain.moving, strict=True):
        matrix = matrix @ segment
        lines.append(Line(matrix[:3, 3].copy(), matrix[:3, :3] @ joint.axis))
    return lines, matrix @ last


def _base(line: Line) -> RigidTransform:
    """The shortest way to a frame with its z on the first axis, as near to the base as it goes."""
    point = line.point - (line.point @ line.along) * line.along
    across = np.cross([0.0, 0.0, 1.0], line.along)
    sine = float(np.linalg.norm(across))
    turn = np.zeros(3)
    if sine > ROUNDING:
        turn = np.arctan2(sine, line.along[2]) * across / sine
    return _rounded(RigidTransform(point, turn))


def _to_axis(frame: Array, line: Line) -> Step:
    """The step from a frame on one axis to one on the next, both in the base frame."""
    inverse = np.linalg.inv(frame)
    point = inverse[:3, :3] @ line.point + inverse[:3, 3]
    along = inverse[:3, :3] @ line.along
    if np.hypot(along[0], along[1]) < NEARLY_PARALLEL:
        return _hayati(point, along)
    normal = np.array([-along[1], along[0], 0.0]) / np.hypot(along[0], along[1])
    z = np.array([0.0, 0.0, 1.0])
    d, _, a = np.linalg.solve(np.stack([z, -along, normal], axis=1), point)
    if normal[0] < -ROUNDING or (abs(normal[0]) <= ROUNDING and a < 0):
        # of the normal's two senses the one that turns less at the joint's zero
        normal, a = -normal, -a
    theta = np.arctan2(normal[1], normal[0])
    alpha = np.arctan2(np.cross(z, along) @ normal, along[2])
    return Step(_round_length(a), _round_angle(alpha), _round_length(d), _round_angle(theta))


def _hayati(point: Array, along: Array) -> Step:
    """To where the next axis meets the plane z = 0, then tilted onto it."""
    meets = point - point[2] / along[2] * along
    a = float(np.hypot(meets[0], meets[1]))
    if a <= MEETING:
        a = theta = 0.0
    else:
        a = -a if meets[0] < -ROUNDING else a
        theta = _round_angle(np.arctan2(meets[1] / a, meets[0] / a))
    tilted = rotation_matrix(np.array([0.0, 0.0, -theta])) @ along
    beta = np.arcsin(np.clip(tilted[0], -1, 1))
    alpha = np.arctan2(-tilted[1], tilted[2])
    return Step(_round_length(a), _round_angle(alpha), 0.0, theta, _round_angle(beta))


def _to_flange(T_axis_flange: Array) -> tuple[Step, RigidTransform]:
    """The last matrix takes what it can of the way to the flange: all where z goes on along z."""
    x, y, z = T_axis_flange[:3, 3]
    if np.hypot(*T_axis_flange[:2, 2]) > ROUNDING:
        return Step(), _rounded(RigidTransform.from_matrix(T_axis_flange))
    a = float(np.hypot(x, y))
    if a <= MEETING:
        a = 0.0
        theta = np.arctan2(*T_axis_flange[1::-1, 0])
    else:
        theta = np.arctan2(y, x)
    step = Step(
        _round_length(a),
        0.0 if T_axis_flange[2, 2] > 0 else np.pi,
        _round_length(z),
        _round_angle(theta),
    )
    rest = np.linalg.inv(step.matrix()) @ T_axis_flange
    return step, _rounded(RigidTransform.from_matrix(rest))


def _rounded(transform: RigidTransform) -> RigidTransform:
    """Without what rounding left; a turn by a round angle about an axis of the frame is kept so."""
    translation = [_round_length(value) for value in transform.translation]
    turn = transform.rotation_vector
    turn = np.array(
        [_round_angle(value) if _alone(turn, i) else value for i, value in enumerate(turn)]
    )
    turn[np.abs(turn) < ROUNDING] = 0.0
    return RigidTransform(np.array(translation), turn)


def _alone(turn: Array, i: int) -> bool:
    others = np.delete(turn, i)
    return bool(np.abs(others).max() < ROUNDING)


def _round_length(value: float) -> float:
    """Without the digits that rounding made up: to a tenth of a picometre."""
    return round(float(value), 13) + 0.0


def _round_angle(value: float) -> float:
    """A multiple of a right angle where the angle is one but for rounding."""
    quarter = np.pi / 2
    turns = round(float(value) / quarter)
    near = abs(float(value) - turns * quarter) < ROUNDING
    return float(turns * quarter) + 0.0 if near else float(value)
