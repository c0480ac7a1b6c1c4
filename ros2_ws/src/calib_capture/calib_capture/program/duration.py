# SPDX-License-Identifier: Apache-2.0
"""How an arm goes from pose to pose, and how long all of a program takes it."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from calib_capture.motion import Leg, MotionLimits
from calib_capture.program.program import PlannedPose, Program
from calib_model.arrays import Array


def visit(
    leg: Leg, pose: PlannedPose, between: Iterable[Array], approach_speed: float, hold: float
) -> None:
    """To a pose by what is `between`, its approach (m/s), and a rest of `hold` s there."""
    for posture in between:
        leg.to(posture)
    if len(pose.approach):
        leg.to(pose.approach[0])
        last = np.vstack([pose.approach[1:], pose.joints])
        leg.along(last, pose.standoff / approach_speed)
    else:
        leg.to(pose.joints)
    leg.rest(hold)


def motion_seconds(
    program: Program, limits: MotionLimits, approach_speed: float, hold: float, batch: int
) -> float:
    """How long the arm moves and stands, s, from where the first pose's way begins.

    Each pose is gone to by its way, held for `hold` s and left by its approach (m/s), `batch` of
    them in one command, with the very legs that a run commands.
    """
    seconds, before = 0.0, None
    for begin in range(0, len(program.poses), batch):
        poses = program.poses[begin : begin + batch]
        leg = Leg(_left_at(poses[0]) if before is None else before.joints, limits)
        for pose in poses:
            if before is not None and len(before.approach):
                leg.along(before.approach[::-1], before.standoff / approach_speed)
            visit(leg, pose, pose.way, approach_speed, hold)
            before = pose
        seconds += leg.seconds
    return seconds


def _left_at(pose: PlannedPose) -> Array:
    """Where the arm is before it goes to the first pose."""
    for postures in (pose.way, pose.approach):
        if len(postures):
            return postures[0]
    return pose.joints
