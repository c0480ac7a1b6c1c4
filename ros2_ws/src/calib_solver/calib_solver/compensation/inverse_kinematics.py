# SPDX-License-Identifier: Apache-2.0
"""Inverse kinematics of any arm by damped Newton steps, many targets at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib_model.arrays import Array
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import tool_motion
from calib_model.transforms import RigidTransform

EXACT = 1e-10  # m, and rad times LEVER
LEVER = 0.3  # m: how much a turn of 1 rad counts for
LARGEST_STEP = 0.5  # rad, of any joint
STEPS = 60
STUCK = 1e-12  # rad: shorter steps lead nowhere
LEAST_DAMPING = 1e-14  # m^2
MOST_DAMPING = 1e3
NEAR = 1e-7  # m: so near a target, going back towards the start may cost as much
AT_LIMIT = 1e-9  # rad


Rows = NDArray[np.int64]


@dataclass(frozen=True)
class Targets:
    """Where a tool is to be: `position` (N, 3), m, and `rotation` (N, 3, 3) or None for any."""

    position: Array
    rotation: Array | None = None

    @property
    def rows(self) -> int:
        """Equations per target: 3 or 6."""
        return 3 if self.rotation is None else 6

    def take(self, rows: Rows) -> Targets:
        """Some of the targets."""
        return Targets(self.position[rows], None if self.rotation is None else self.rotation[rows])


@dataclass(frozen=True)
class Reached:
    """Postures `q` (N, n), rad; `miss` (N,), m, how far off each is; `limit` (N,) the joint, from
    0, that would have to pass its limit, or -1."""

    q: Array
    miss: Array
    limit: Rows

    @property
    def arrived(self) -> NDArrayBool:
        """Which targets are reached within the limits, shape (N,)."""
        there: NDArrayBool = (self.miss < EXACT) & (self.limit < 0)
        return there


def reach(
    arm: Arm, tool: RigidTransform, targets: Targets, start: Array, stay: bool = True
) -> Reached:
    """Postures within the limits that bring the tool to the targets, from `start` (N, n), rad.

    With `stay`, of all the postures that do the one nearest to the start is found: arms with more
    joints than a target has equations change the least. A joint that would pass its limit is held
    there and the others make up for it, if they can.
    """
    q = np.array(arm.check_joints(start))
    free = np.ones(q.shape, dtype=bool)
    miss = np.full(len(q), np.inf)
    passed = np.full(len(q), -1, dtype=np.int64)
    rows: Rows = np.arange(len(q))
    back = q.copy() if stay and targets.rows < arm.n else None
    lower, upper = arm.limits.T
    for _ in range(arm.n + 1):
        q[rows], miss[rows] = _newton(
            arm,
            tool,
            targets.take(rows),
            q[rows],
            free[rows],
            back[rows] if back is not None else None,
        )
        beyond = np.maximum(lower - q[rows], q[rows] - upper)
        worst = np.argmax(beyond, axis=1)
        out = (np.max(beyond, axis=1) > AT_LIMIT) & (miss[rows] < EXACT)
        rows, joint = rows[out], worst[out]
        passed[rows] = joint
        if targets.rows >= arm.n or not len(rows):
            break
        free[rows, joint] = False
        q[rows, joint] = np.clip(q[rows, joint], lower[joint], upper[joint])
    inside = arm.within_limits(q, -AT_LIMIT) & (miss < EXACT)
    return Reached(q, miss, np.where(inside, -1, passed))


def _newton(
    arm: Arm,
    tool: RigidTransform,
    targets: Targets,
    q: Array,
    free: NDArrayBool,
    stay: Array | None,
) -> tuple[Array, Array]:
    """Postures and what they miss by (N,), m, after as many steps as it takes or `STEPS`.

    A step that leaves a target farther off is not taken but damped more.
    """
    q = q.copy()
    damping = np.full(len(q), LEAST_DAMPING)
    error, jacobian = equations(arm, tool, q, targets)
    miss = np.linalg.norm(error, axis=1)
    left: Rows = np.arange(len(q))
    for _ in range(STEPS):
        moving = jacobian[left] * free[left][:, None, :]
        away = None if stay is None else (stay[left] - q[left]) * free[left]
        step = _step(error[left], moving, away, damping[left])
        going = np.abs(step).max(axis=1) >= np.where(miss[left] < EXACT, AT_LIMIT, STUCK)
        left, step = left[going], step[going]
        if not len(left):
            break
        tried = q[left] + step
        error_there, jacobian_there = equations(arm, tool, tried, targets.take(left))
        miss_there = np.linalg.norm(error_there, axis=1)
        better = miss_there < np.maximum(miss[left], NEAR)
        damping[left] = np.clip(
            damping[left] * np.where(better, 0.1, 10.0), LEAST_DAMPING, MOST_DAMPING
        )
        # a refused first step shows that undamped ones go too far here
        damping[left[~better]] = np.maximum(damping[left[~better]], miss[left[~better]] ** 2)
        at = left[better]
        q[at], error[at], jacobian[at] = tried[better], error_there[better], jacobian_there[better]
        miss[at] = miss_there[better]
    return q, miss


def equations(arm: Arm, tool: RigidTransform, q: Array, targets: Targets) -> tuple[Array, Array]:
    """What is left to go (N, m), m, and its derivative by the joints (N, m, n), m/rad; turns count
    as lengths at LEVER."""
    now = tool_motion(arm, q, tool)
    gap = targets.position - now.position
    if targets.rotation is None:
        return gap, now.jacobian[:, :3]
    turn = Rotation.from_matrix(targets.rotation @ np.swapaxes(now.rotation, 1, 2)).as_rotvec()
    scale = np.array([1.0, 1.0, 1.0, LEVER, LEVER, LEVER])
    return np.concatenate([gap, LEVER * turn], axis=1), now.jacobian * scale[:, None]


def _step(error: Array, jacobian: Array, away: Array | None, damping: Array) -> Array:
    """The damped step (N, n), no joint's above the largest; `away` (N, n) points back to where to
    stay near, as far as that changes nothing about the targets."""
    transposed = np.swapaxes(jacobian, 1, 2)
    square = jacobian @ transposed + damping[:, None, None] * np.eye(jacobian.shape[1])
    wanted = error[:, :, None]
    if away is not None:
        wanted = wanted - jacobian @ away[:, :, None]
    step: Array = (transposed @ np.linalg.solve(square, wanted))[:, :, 0]
    if away is not None:
        step = away + step
    longest = np.abs(step).max(axis=1, keepdims=True)
    shortened: Array = step * np.minimum(1.0, LARGEST_STEP / np.maximum(longest, LARGEST_STEP))
    return shortened
