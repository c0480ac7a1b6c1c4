# SPDX-License-Identifier: Apache-2.0
"""A commanded joint trajectory, and what joint_trajectory_controller refuses of one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, NDArrayBool

NO_SPEED = 1.2e-7  # rad/s: what a controller lets pass as no velocity at the end


class TrajectoryError(CalibrationError):
    """A trajectory that the arm does not follow."""


@dataclass(frozen=True)
class Trajectory:
    """Where the joints are to be: `positions` (K, n) in rad at `seconds` (K,) from the start, and
    as far as they are given their `velocities` (K, n) in rad/s and `accelerations` (K, n). The
    start is when it is received or, if given, at a `stamp` (ns) of the arm's clock."""

    seconds: Array
    positions: Array
    velocities: Array | None = None
    accelerations: Array | None = None
    stamp: int = 0

    @property
    def duration(self) -> float:
        """Seconds from the start to the last point."""
        return float(self.seconds[-1])


Rows = Sequence[Sequence[float]]


def checked_trajectory(
    arm: Arm,
    names: Sequence[str],
    seconds: Sequence[float],
    positions: Rows,
    velocities: Rows = (),
    accelerations: Rows = (),
) -> Trajectory:
    """A trajectory in the arm's joint order from one whose `names` are in any order.

    Empty rows of `velocities` and `accelerations` are fields that a point does not have; what not
    every point has plays no part.

    Raises:
        TrajectoryError: what joint_trajectory_controller of Jazzy rejects, with its reason: no
            points, joints missing or unknown, times that do not increase, fields of another
            length, a velocity at the last point. Or a number that is not finite.
    """
    if sorted(names) != sorted(arm.joint_names):
        raise TrajectoryError(
            f'trajectory for joints {", ".join(names) or "none"}: '
            f'expected {", ".join(arm.joint_names)}'
        )
    if not len(positions):
        raise TrajectoryError('empty trajectory: to stop the arm, send where it is to stand')
    order = [list(names).index(name) for name in arm.joint_names]
    q = _field(arm, positions, 'positions', order)
    v = _field(arm, velocities, 'velocities', order) if _all(velocities) else None
    a = _field(arm, accelerations, 'accelerations', order) if _all(accelerations) else None
    if len(velocities) and len(velocities[-1]):
        _refuse_moving_end(np.asarray(velocities[-1]))
    times = frozen(np.asarray(seconds, dtype=np.float64))
    found = Trajectory(times, q, v, a if v is not None else None)
    check_trajectory(found)
    return found


def check_trajectory(given: Trajectory) -> None:
    """What is left to be looked at where all points have fields of the right length.

    Raises:
        TrajectoryError: a number is not finite, the times do not increase, or it does not end at
            rest.
    """
    times = given.seconds
    _refuse(np.insert(times[1:] <= times[:-1], 0, False), 'is not later than the one before')
    _refuse(times < 0.0, 'is due before the start')
    for what in ('positions', 'velocities', 'accelerations'):
        rows = getattr(given, what)
        if rows is not None:
            _refuse(np.any(~np.isfinite(rows), axis=1), f'has {what} that are no numbers')
    if given.velocities is not None:
        _refuse_moving_end(given.velocities[-1])


def _refuse_moving_end(velocity: Array) -> None:
    if np.abs(velocity).max() > NO_SPEED:
        raise TrajectoryError('the velocity of the last trajectory point is not zero')


def _all(rows: Rows) -> bool:
    return bool(len(rows)) and all(len(row) for row in rows)


def _field(arm: Arm, rows: Rows, what: str, order: list[int]) -> Array:
    for number, row in enumerate(rows, start=1):
        if len(row) != arm.n:
            raise TrajectoryError(
                f'trajectory point {number}: expected {arm.n} {what}, got {len(row)}'
            )
    values = np.asarray(rows, dtype=np.float64).reshape(-1, arm.n)[:, order]
    return frozen(values)


def _refuse(bad: NDArrayBool, problem: str) -> None:
    if bad.any():
        raise TrajectoryError(f'trajectory point {int(np.argmax(bad)) + 1} {problem}')


def travel_time(start: Array, goals: Array, velocity: Array) -> Array:
    """Seconds (K,) from posture `start` (n,) to `goals` (K, n) at the joints' speeds (n,)."""
    finite = np.where(np.isfinite(velocity), velocity, 1.0)
    seconds: Array = np.max(np.abs(goals - start) / finite, axis=1)
    return seconds
