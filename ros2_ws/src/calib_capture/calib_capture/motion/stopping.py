# SPDX-License-Identifier: Apache-2.0
"""A stop on the way: one point at which the arm comes to rest within its limits.

A controller that is given a single point goes there from the state that it commands at that moment,
by a quintic polynomial. So nobody needs to know that state to the millisecond: the point is such
that the way there is within the limits from any state in which the arm may be by then.
"""

from __future__ import annotations

import numpy as np

from calib_capture.motion.interpolated_motion import (
    InterpolatedMotion,
    MotionState,
    derivatives,
    quintic,
)
from calib_capture.motion.limits import MotionLimits
from calib_capture.motion.trajectory import Trajectory
from calib_model.arrays import Array, frozen

SECONDS = frozen(0.1 * 1.09 ** np.arange(27))  # s that a stop may take, up to 0.94
STATES = 5  # between the earliest and the latest in which the arm may be
LOOKS = 13  # instants of the way at which limits are looked at
PASSED = 2e-4  # rad beyond the planned way
PARTS = (0.3, 0.6, 0.8, 1.0)  # of the way that is left, at the end of which it may rest
NEARLY = 0.99  # of every limit
NEVER = 100.0  # times a limit


def stop(
    motion: InterpolatedMotion, earliest: float, latest: float, limits: MotionLimits
) -> Trajectory | None:
    """How to stop an arm that is on its way, between `earliest` and `latest` s after the start.

    It stays on the straight leg that it is on. None where that cannot be done within the limits:
    shortly before the end of the leg, at which it comes to rest by itself.
    """
    goals, strain = _candidates(motion, earliest, latest, limits)
    good = (strain <= 1.0).any(axis=0)
    if not good.any():
        return None
    soonest = int(np.argmax(good))
    return _point(SECONDS[soonest], goals[int(np.argmin(strain[:, soonest])), soonest])


def gentlest(motion: InterpolatedMotion, seconds: float, limits: MotionLimits) -> Trajectory:
    """The stop that goes least beyond the limits, of an arm that is `seconds` on its way."""
    goals, strain = _candidates(motion, seconds, seconds, limits)
    kind, duration = np.unravel_index(int(np.argmin(strain)), strain.shape)
    return _point(SECONDS[duration], goals[kind, duration])


def _candidates(
    motion: InterpolatedMotion, earliest: float, latest: float, limits: MotionLimits
) -> tuple[Array, Array]:
    """Where to rest (G, K, n), by kinds of goals and by `SECONDS`, and how near to the limits the
    ways there come (G, K)."""
    states = [motion.at(t) for t in np.linspace(earliest, latest, STATES)]
    middle = states[STATES // 2]
    ends = motion.leg((earliest + latest) / 2)
    h = SECONDS[:, None]
    coasted = middle.position + middle.velocity * h / 2 + middle.acceleration * h**2 / 12
    left = ends[1] - middle.position
    parts = (np.broadcast_to(middle.position + left * part, coasted.shape) for part in PARTS)
    goals = np.array([coasted, *parts])
    return goals, np.array([_strain(states, each, ends, limits) for each in goals])


def _point(seconds: np.float64, goal: Array) -> Trajectory:
    still = np.zeros((1, len(goal)))
    return Trajectory(frozen([float(seconds)]), frozen(goal[None]), frozen(still), frozen(still))


def _strain(
    states: list[MotionState], goals: Array, ends: tuple[Array, Array], limits: MotionLimits
) -> Array:
    """How near the ways from all states to each of the goals (K, n) come to the limits, (K,); more
    than 1 beyond them, and much more where they leave the ranges or go past the leg's end."""
    start = MotionState(*(np.array(each)[:, None] for each in zip(*states, strict=True)))
    none = np.zeros_like(goals)
    c = quintic(start, MotionState(goals[None], none, none), SECONDS[None, :, None])
    since = SECONDS[:, None] * np.linspace(0.0, 1.0, LOOKS)
    q, v, a, j = derivatives(c[:, :, None], since[None])
    strain = (np.abs(v) / limits.velocity).max(axis=-1)
    for each, limit in ((a, limits.acceleration), (j, limits.jerk)):
        strain = np.maximum(strain, (np.abs(each) / (limit * NEARLY)).max(axis=-1))
    out = ((q < limits.position[:, 0]) | (q > limits.position[:, 1])).any(axis=-1)
    strain = np.where(out, NEVER, strain)
    way = ends[1] - ends[0]
    far = np.abs(way).max()
    if far > PASSED:
        gone = (q - ends[0]) @ way / (way @ way)
        strain = np.where(gone > 1 + PASSED / far, NEVER + strain, strain)
    worst: Array = strain.max(axis=(0, 2))
    return worst
