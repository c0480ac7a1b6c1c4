# SPDX-License-Identifier: Apache-2.0
"""Small motions of one joint after the other, within what the styli can take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import ActiveProbe, Arm

SHARE = 0.6  # of the room that styli have, that a joint's motion may take at most
LEAST_ROOM = 3e-4  # m, without which nothing is moved
WIDEST = 0.02  # rad that a joint turns at most
QUICKEST = 0.25  # s from one end to the other
STATES = 15  # joint states from one end to the other, at least
AROUND = 5e-4  # m at the probe, of a turn in a capture: less than placements are off by
JERK, ACCELERATION = 20.0, 4.0  # rad/s^3, rad/s^2: far less than any arm can
PEAK_JERK, PEAK_ACCELERATION = 60.0, 5.7735  # of a quintic from rest to rest, of way / time^3, ^2


@dataclass(frozen=True)
class SmallMove:
    """Joint `joint` (from 0) goes to both sides and back: `positions` (K, n) at rest at `seconds`
    (K,) from the start."""

    joint: int
    seconds: Array
    positions: Array


def small_moves(
    arm: Arm, probe: ActiveProbe, joints: Array, displacement: Array, rate: float = 100.0
) -> list[SmallMove]:
    """Moves from the posture (n,) in which the styli are displaced by (3,), one for each joint, for
    joint states that come at `rate` (Hz).

    However joints and styli are counted, the sphere moves in the probe by no more than a share of
    the styli's room: what reaches farthest from a joint's axis is its length stretched out.

    Raises:
        CalibrationError: a stylus is too near an end of its stroke.
    """
    lower, upper = probe.stroke.T
    room = float(np.minimum(displacement - lower, upper - displacement).min())
    if room < LEAST_ROOM:
        raise CalibrationError(
            f'a stylus is {room * 1e3:.2f} mm from the end of its stroke: put the sphere into the '
            'middle of the probe'
        )
    moves = []
    for joint, far in enumerate(_farthest(arm, probe)):
        turn = min(SHARE * room / far, WIDEST)
        low, high = arm.joints[joint].limits
        middle = joints[joint]
        stops = np.clip([middle + turn, middle - turn, middle], low, high)
        positions = np.repeat(joints[None], len(stops), axis=0)
        positions[:, joint] = stops
        ways = np.abs(np.diff(stops, prepend=middle))
        moves.append(SmallMove(joint, np.cumsum([_duration(way, rate) for way in ways]), positions))
    return moves


def small_turns_at(arm: Arm, probe: ActiveProbe, joints: Array, displacement: Array) -> Array:
    """How far (n,), rad, each joint may turn from a posture (n,), one after the other; 0 where
    styli that are displaced by (3,) would be too near an end of their stroke."""
    lower, upper = probe.stroke.T
    room = float(np.minimum(displacement - lower, upper - displacement).min())
    if room < LEAST_ROOM:
        return np.zeros(arm.n)
    most = min(SHARE * room, AROUND)
    turns = np.minimum([most / far for far in _farthest(arm, probe)], WIDEST)
    over = joints + turns > arm.limits[:, 1]
    return np.where(over, -turns, turns)


def _duration(way: float, rate: float) -> float:
    """Seconds (s) for a way (rad) from rest to rest by a quintic."""
    by_jerk = (PEAK_JERK * way / JERK) ** (1 / 3)
    by_acceleration = np.sqrt(PEAK_ACCELERATION * way / ACCELERATION)
    return float(max(QUICKEST, STATES / rate, by_jerk, by_acceleration))


def _farthest(arm: Arm, probe: ActiveProbe) -> list[float]:
    """How far (m) from each joint's axis the probe can be at most; 1 where the joint slides."""
    a, _, d, *_ = arm.geometry
    end = float(np.linalg.norm(arm.dh_T_flange.translation))
    end += float(np.linalg.norm(probe.flange_T_probe.translation))
    links = np.hypot(a, d)
    return [
        1.0 if joint.prismatic else abs(a[i]) + float(links[i + 1 :].sum()) + end
        for i, joint in enumerate(arm.joints)
    ]
