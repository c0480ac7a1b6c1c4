# SPDX-License-Identifier: Apache-2.0
"""Encoders that begin anew after a turn: joints that jump by it between two neighbours go on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array

TURN = 2 * np.pi
NEAR = 1.0  # rad that a joint may have gone beside, between two joint states


@dataclass(frozen=True)
class Turns:
    """How often each joint (n,) jumped by a turn, and where it counts from, rad, `low` (n,)."""

    jumps: NDArray[np.int64]
    low: Array

    def as_counted(self, joints: Array) -> Array:
        """Joints (K, n), rad, as their encoders count them."""
        back = self.low + np.mod(joints - self.low, TURN)
        return np.where(self.jumps > 0, back, joints)


def unwrapped(joints: Array) -> tuple[Array, Turns]:
    """Joints (M, n), rad, in the order of time, without jumps of a turn, and what was jumped.

    A joint that goes through more than a turn by itself is left as it is.
    """
    jumps = np.zeros(joints.shape[1], dtype=np.int64)
    if len(joints) < 2:
        return joints, Turns(jumps, np.zeros(joints.shape[1]))
    low, high = joints.min(axis=0), joints.max(axis=0)
    mended = joints
    for number, column in enumerate(joints.T):
        step = np.diff(column)
        jump = np.abs(np.abs(step) - TURN) < NEAR
        if high[number] - low[number] > TURN + 1e-3 or not jump.any():
            continue
        jumps[number] = jump.sum()
        mended = joints.copy() if mended is joints else mended
        mended[1:, number] += TURN * np.cumsum(np.where(jump, -np.sign(step), 0.0))
    return mended, Turns(jumps, low)
