# SPDX-License-Identifier: Apache-2.0
"""Where a simulated arm stands when nobody has moved it yet."""

from __future__ import annotations

import numpy as np

from calib_capture.motion import CollisionCheck, bodies_of
from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform

DRAWN = 300  # postures that are looked at
AWAY = RigidTransform(frozen([0.0, 0.0, 1e3]))  # where no gauge is in the way


def posture_to_begin_in(arm: Arm, probe: Probe, gauge: Gauge) -> Array:
    """Zero (n,), or as near as limits let, where arm and probe touch neither one another nor the
    floor there; where they do, of some postures the one that has its flange highest: above what
    stands about."""
    check = CollisionCheck(arm, bodies_of(arm, probe, gauge))
    check.put_gauge(AWAY, -1)
    if not check.touches(arm.zero):
        return frozen(arm.zero)
    lower, upper = arm.ranges.T
    drawn = np.random.default_rng(0).uniform(lower, upper, (DRAWN, arm.n))
    height = forward_kinematics(arm, drawn)[:, 2, 3]
    for row in np.argsort(-height):
        if not check.touches(drawn[row]):
            return frozen(drawn[row])
    return frozen(arm.zero)
