# SPDX-License-Identifier: Apache-2.0
"""Coming to a sphere and leaving it along the probe's axis, and how near that is to singular."""

from __future__ import annotations

import numpy as np

from calib_capture.motion.newton import reached
from calib_capture.motion.pinocchio_arm import PinocchioArm
from calib_model.arrays import Array

STEP = 0.015  # m between the postures of an approach: in between it bends by some 0.1 mm
EXACT = 1e-7  # m and rad: a way need not be straighter
ITERATIONS = 8


def retreat(model: PinocchioArm, q: Array, back: Array, length: float) -> Array | None:
    """Postures (S, n) on the way back from q (n,), the hand's orientation kept; the nearest first.

    `back` (3,) is the unit vector to go along in the base frame, `length` in m. None where the
    arm cannot follow. Newton from posture to posture, so the branch stays the same.
    """
    steps = max(int(np.ceil(length / STEP)), 1)
    start = model.flange_pose(q)
    goal = start.copy()
    found = np.empty((steps, len(q)))
    here = np.array(q, dtype=np.float64)
    for step in range(steps):
        target = start[:3, 3] + back * length * (step + 1) / steps
        goal[:3, 3] = target
        there = reached(model, here, goal, EXACT, ITERATIONS)
        if there is None:
            return None
        found[step] = here = there
    return found


def singular_margin(model: PinocchioArm, q: Array, reach: float) -> float:
    """How far posture q (n,) is from a singular one: 0 there, of the order of 1 far from it.

    The smallest singular value of the flange's Jacobian, lengths in units of `reach` (m).
    """
    jacobian = model.flange_jacobian(q).copy()
    jacobian[:3] /= reach
    return float(np.linalg.svd(jacobian, compute_uv=False)[-1])
