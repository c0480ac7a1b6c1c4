# SPDX-License-Identifier: Apache-2.0
"""What a joint's motion must keep: position, velocity, acceleration and jerk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm

#: where neither the arm's description nor anybody else says: gentle for an industrial arm
VELOCITY, ACCELERATION, JERK = 1.0, 5.0, 50.0  # rad/s, rad/s^2, rad/s^3


@dataclass(frozen=True)
class MotionLimits:
    """Limits of n joints: `position` (n, 2) in rad, `velocity` (n,) in rad/s, `acceleration` (n,)
    in rad/s^2, `jerk` (n,) in rad/s^3."""

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array

    def share(self, velocity: float, acceleration: float, jerk: float) -> MotionLimits:
        """Shares of the limits of motion, each more than 0 and up to 1."""
        return MotionLimits(
            self.position,
            frozen(self.velocity * velocity),
            frozen(self.acceleration * acceleration),
            frozen(self.jerk * jerk),
        )


def motion_limits(arm: Arm, acceleration: float = ACCELERATION, jerk: float = JERK) -> MotionLimits:
    """The limits of an arm: its description's, and what is given (rad/s^2, rad/s^3) for joints of
    which that says nothing."""
    return MotionLimits(
        frozen(arm.limits),
        frozen(np.where(np.isfinite(arm.velocity), arm.velocity, VELOCITY)),
        frozen(np.where(np.isfinite(arm.acceleration), arm.acceleration, acceleration)),
        frozen(np.where(np.isfinite(arm.jerk), arm.jerk, jerk)),
    )
