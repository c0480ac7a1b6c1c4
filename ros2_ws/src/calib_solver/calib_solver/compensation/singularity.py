# SPDX-License-Identifier: Apache-2.0
"""Joint commands near a singularity: the program's own branch, as near the target as it allows.

There a small error of the tool asks for large turns of some joints, and for other ones on either
side. A joint program went through smoothly; what is made good of it has to go as smoothly. So the
part of a correction that the joints can hardly give is given up by degrees, and named.
"""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import tool_motion
from calib_model.transforms import RigidTransform
from calib_solver.compensation.inverse_kinematics import Targets, equations

LARGEST_CHANGE = 0.1  # rad: a correction that would change joints by more is held back
LONGER = 2.0  # times the program's own step, and
STRAY = 0.02  # rad more: a longer step from row to row is a jump
AROUND = 2.0
STEPS = 30
SETTLED = 1e-12  # rad


def jumps(program: Array, q: Array) -> NDArrayBool:
    """Between which rows (N - 1,) of q (N, n), rad, a joint goes much further than in the program;
    rows that are no numbers jump nowhere."""
    own, step = (np.abs(np.diff(rows, axis=0)).max(axis=1) for rows in (program, q))
    longer: NDArrayBool = step > LONGER * own + STRAY
    return longer


def near_singular(
    arm: Arm, tool: RigidTransform, targets: Targets, q: Array
) -> tuple[NDArrayBool, float]:
    """At which postures (N, n), rad, the way to the targets may take large turns, and the singular
    value (m/rad) below which it is given up by degrees: that at which the largest error along the
    weakest direction asks for LARGEST_CHANGE."""
    error, jacobian = equations(arm, tool, q, targets)
    u, values, _ = np.linalg.svd(jacobian, full_matrices=False)
    along = np.abs(np.einsum('nj,nj->n', u[:, :, -1], error))  # what the weakest direction is to do
    least = float(along.max(initial=0.0)) / LARGEST_CHANGE
    near: NDArrayBool = values[:, -1] < AROUND * least  # the way there may lead nearer
    return near, least


def reach_near(
    arm: Arm, tool: RigidTransform, targets: Targets, start: Array, least: float
) -> Array:
    """Postures (N, n), rad, that bring the tool near the targets in the start's own branch.

    Damped least squares with a damping of its own for each singular value s below `least` (m/rad):
    a direction moves by s (u'e) / least^2, so by all of its error at s = least and by nothing at
    the singularity. (The damping grows as the singular value falls, after Nakamura and Hanafusa,
    1986; numerically filtered, after Maciejewski and Klein, 1988.)
    """
    q = np.array(start)
    for _ in range(STEPS):
        error, jacobian = equations(arm, tool, q, targets)
        u, values, vt = np.linalg.svd(jacobian, full_matrices=True)
        count = values.shape[1]
        damping = np.maximum(least**2 - values**2, 0.0)
        along = np.einsum('nji,nj->ni', u, error)
        back = np.einsum('nij,nj->ni', vt, start - q)
        part = back.copy()
        part[:, :count] = (values * along + damping * back[:, :count]) / (values**2 + damping)
        step = np.einsum('nij,ni->nj', vt, part)
        q = q + step
        if np.abs(step).max(initial=0.0) < SETTLED:
            break
    return q


def left_over(arm: Arm, tool: RigidTransform, targets: Targets, q: Array) -> tuple[Array, Array]:
    """How far the tool at q (N, n), rad, is from the targets: (N,), m, and (N,), rad."""
    now = tool_motion(arm, q, tool)
    away = np.linalg.norm(targets.position - now.position, axis=1)
    if targets.rotation is None:
        return away, np.zeros(len(away))
    chord = np.linalg.norm(targets.rotation - now.rotation, axis=(1, 2)) / np.sqrt(8)
    return away, 2 * np.arcsin(np.clip(chord, 0.0, 1.0))
