# SPDX-License-Identifier: Apache-2.0
"""Following a joint trajectory: straight lines between its points, never too fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, NDArrayBool

DWELL_STEP = 0.05  # s: at rest, states this near let a probe be read between them
MOTION_STEP = 5.0  # s: on the way, where nothing is measured
REST = 1e-12  # rad


class TrajectoryError(CalibrationError):
    """A trajectory that the arm does not follow."""


@dataclass(frozen=True)
class Trajectory:
    """Where the joints are to be: `positions` (K, n) in rad at `seconds` (K,) from the start."""

    seconds: Array
    positions: Array


def checked_trajectory(
    arm: Arm, names: Sequence[str], seconds: Sequence[float], positions: Sequence[Sequence[float]]
) -> Trajectory:
    """A trajectory in the arm's joint order from one whose `names` are in any order.

    Raises:
        TrajectoryError: a joint is missing, unknown or out of its limits, a point has too few or
            too many positions, a number is not finite, or the times do not increase.
    """
    if sorted(names) != sorted(arm.joint_names):
        raise TrajectoryError(
            f'trajectory for joints {", ".join(names) or "none"}: '
            f'expected {", ".join(arm.joint_names)}'
        )
    for number, point in enumerate(positions, start=1):
        if len(point) != arm.n:
            raise TrajectoryError(
                f'trajectory point {number}: expected {arm.n} positions, got {len(point)}'
            )
    order = [list(names).index(name) for name in arm.joint_names]
    times = np.asarray(seconds, dtype=np.float64)
    q = np.asarray(positions, dtype=np.float64).reshape(-1, arm.n)[:, order]
    _refuse(np.any(~np.isfinite(q), axis=1), 'has a position that is no number')
    _refuse(np.less(times, 0.0), 'is due before the start')
    late = np.insert(np.less_equal(times[1:], times[:-1]), 0, [False] * min(len(times), 1))
    _refuse(late, 'is not later than the one before')
    for joint, column in zip(arm.joints, q.T, strict=True):
        lower, upper = joint.limits
        outside = (column < lower) | (column > upper)
        _refuse(outside, f'takes {joint.name} out of its limits {lower:.4f} to {upper:.4f} rad')
    return Trajectory(frozen(times), frozen(q))


def _refuse(bad: NDArrayBool, problem: str) -> None:
    if bad.any():
        raise TrajectoryError(f'trajectory point {int(np.argmax(bad)) + 1} {problem}')


class Motion:
    """The way from posture `start` (n,) along a trajectory, as slow as the slowest joint needs.

    A segment that asks for more than `velocity` (n,) rad/s takes longer, and all that follows it
    comes later. Points' velocities and accelerations play no part.
    """

    def __init__(self, start: Array, trajectory: Trajectory, velocity: Array) -> None:
        positions = np.vstack([start, trajectory.positions])
        steps = np.diff(positions, axis=0)
        asked = np.diff(trajectory.seconds, prepend=0.0)
        durations = np.maximum(asked, np.max(np.abs(steps) / velocity, axis=1))
        kept = durations > 0
        self.positions = np.vstack([positions[0], positions[1:][kept]])
        self.seconds = np.concatenate([[0.0], np.cumsum(durations[kept])])
        self._speeds = steps[kept] / durations[kept, None]

    @classmethod
    def resting(cls, at: Array) -> Motion:
        """No motion at all."""
        return cls(at, Trajectory(np.zeros(0), np.zeros((0, len(at)))), np.ones(len(at)))

    @property
    def duration(self) -> float:
        """Seconds until the last point."""
        return float(self.seconds[-1])

    def at(self, seconds: float) -> tuple[Array, Array]:
        """Positions (n,) in rad and speeds (n,) in rad/s, `seconds` after the start.

        Between motion and rest a joint stands still; before and after everything too.
        """
        coming = int(np.searchsorted(self.seconds, seconds, side='right'))
        going = int(np.searchsorted(self.seconds, seconds, side='left'))
        if coming == len(self.seconds) or going == 0:
            last = self.positions[-1] if coming == len(self.seconds) else self.positions[0]
            return last, np.zeros(len(last))
        speed = self._speeds[coming - 1]
        position = self.positions[coming - 1] + speed * (seconds - self.seconds[coming - 1])
        before = self._speeds[going - 1]
        return position, np.where(speed * before == 0, 0.0, (speed + before) / 2)

    def instants(self) -> Array:
        """Where a stepped simulation looks, s: ends of rests and motions, and a few between.

        Points that are passed by without a rest are not looked at, but for those of a motion that
        comes back to where it began: it would not be seen.
        """
        found: list[Array] = [np.zeros(1)]
        for first, last, resting in self._stretches():
            begin, end = self.seconds[first], self.seconds[last]
            if not resting and np.abs(self.positions[last] - self.positions[first]).max() < REST:
                found.append(self.seconds[first + 1 : last + 1])
                continue
            steps = int(np.ceil((end - begin) / (DWELL_STEP if resting else MOTION_STEP)))
            steps = max(steps, 2 if resting else 1)
            found.append(np.append(begin + (end - begin) * np.arange(1, steps) / steps, end))
        return np.concatenate(found)

    def _stretches(self) -> list[tuple[int, int, bool]]:
        """Rests and motions between them: the numbers of their first and last point, and which."""
        far = np.abs(np.diff(self.positions, axis=0)).max(axis=1, initial=0.0)
        stretches: list[tuple[int, int, bool]] = []
        for number, resting in enumerate((far < REST).tolist()):
            if stretches and not resting and not stretches[-1][2]:
                stretches[-1] = (stretches[-1][0], number + 1, False)
            else:
                stretches.append((number, number + 1, resting))
        return stretches


def travel_time(start: Array, goals: Array, velocity: Array) -> Array:
    """Seconds (K,) from posture `start` (n,) to `goals` (K, n) at the joints' speeds (n,)."""
    finite = np.where(np.isfinite(velocity), velocity, 1.0)
    seconds: Array = np.max(np.abs(goals - start) / finite, axis=1)
    return seconds


SHORTEST_MOVE = 0.15  # s: arms take their time to set off and to stop


class Leg:
    """From posture `here` on, at joint speeds (n,) in rad/s; `seconds` are from the start."""

    def __init__(self, here: Array, velocity: Array) -> None:
        self.here = here
        self.seconds: list[float] = []
        self.positions: list[Array] = []
        self._velocity = velocity
        self._now = 0.0

    def to(self, posture: Array, slowest: float = SHORTEST_MOVE) -> None:
        """On to a posture (n,), in `slowest` s or what the joints need."""
        self._now += max(float(travel_time(self.here, posture[None], self._velocity)[0]), slowest)
        self._append(posture)

    def along(self, postures: Array, seconds: float) -> None:
        """By all of some postures (K, n), in so many seconds or what the joints need."""
        for posture in postures:
            self.to(posture, max(seconds, SHORTEST_MOVE) / len(postures))

    def rest(self, seconds: float) -> None:
        """Stay."""
        self._now += seconds
        self._append(self.here)

    def _append(self, posture: Array) -> None:
        self.seconds.append(self._now)
        self.positions.append(posture)
        self.here = posture
