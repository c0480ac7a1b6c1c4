# SPDX-License-Identifier: Apache-2.0
"""Straight legs in joint space from rest to rest, as fast as velocity, acceleration and jerk let.

Ruckig times the way along a leg. Its acceleration is linear between a few instants, so that points
at these alone, with position, velocity and acceleration, tell a controller that interpolates with
quintic polynomials the very motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import ruckig

from calib_capture.motion.limits import MotionLimits
from calib_capture.motion.trajectory import Trajectory
from calib_model.arrays import Array, frozen
from calib_model.errors import CalibrationError
from calib_model.stamps import SECOND

LEAD = 0.1  # s at the start in which a controller comes from where it holds to where we see it
SHORTEST_PHASE = 1e-3  # s: rounded stamps of points nearer in time would be seen in the jerk
EASIER, TRIALS = 0.98, 40  # what acceleration is tried next where a phase is shorter, and how often
LEGS = 1 << 14  # that are timed once: a run commands what its program was timed by
SHORTEST_TURN = 0.2  # s that a small turn takes
NEXT_TURN = 0.25  # of it, after which the next joint begins
TURN_POINTS = 20
PEAKS = (4.09, 39.5, 340.0)  # of velocity, acceleration and jerk, in turns / T, / T^2, / T^3
NEAR, TINY = 1e-9, 1e-12  # rad: no way at all


class MotionError(CalibrationError):
    """A way for which there is no motion within the limits."""


class Phase(NamedTuple):
    """The end of a stretch of constant jerk: `seconds` from the start, the way gone so far, from 0
    to 1, its speed and its acceleration."""

    seconds: float
    way: float
    speed: float
    acceleration: float


class Leg:
    """From posture `here` (n,), at rest, by straight ways with a rest at the end of each."""

    def __init__(self, here: Array, limits: MotionLimits) -> None:
        self.here = here
        self.seconds = LEAD
        self._limits = np.stack([limits.velocity, limits.acceleration, limits.jerk])
        self._phases = [Phase(LEAD, 0.0, 0.0, 0.0)]
        self._from: list[Array] = [here]
        self._ways: list[Array] = [np.zeros(len(here))]
        self._begins = [0.0]
        self._counts = [1]
        self._turns: list[tuple[int, Trajectory]] = []  # and before which phase

    @property
    def moves(self) -> bool:
        """Whether it goes anywhere."""
        return len(self._counts) > 1

    def to(self, posture: Array, seconds: float = 0.0) -> None:
        """On to a posture (n,), no joint faster than if it took `seconds` at an even pace."""
        way = posture - self.here
        far = np.maximum(np.abs(way), TINY)
        if far.max() < NEAR:
            return
        velocity, acceleration, jerk = (self._limits / far).min(axis=1).tolist()
        if seconds > 0:
            velocity = min(velocity, 1.0 / seconds)
        self._add(way, timed(velocity, acceleration, jerk))
        self.here = posture

    def along(self, postures: Array, seconds: float) -> None:
        """By all of some postures (K, n), in so many seconds or what the joints need."""
        for posture in postures:
            self.to(posture, seconds / len(postures))

    def rest(self, seconds: float) -> None:
        """Stay."""
        whole = round(seconds * SECOND) / SECOND
        if whole > 0:
            self._add(np.zeros(len(self.here)), [Phase(whole, 0.0, 0.0, 0.0)])

    def turn(self, turns: Array) -> None:
        """Each joint after the other by `turns` (n,) and back, without a rest between."""
        if np.abs(turns).max() < NEAR:
            return
        motion = small_turns(self.here, turns, self._limits)
        later = replace(motion, seconds=self.seconds + motion.seconds)
        self._turns.append((len(self._phases), later))
        self.seconds = float(later.seconds[-1])

    def _add(self, way: Array, phases: Sequence[Phase]) -> None:
        self._from.append(self.here)
        self._ways.append(way)
        self._begins.append(self.seconds)
        self._counts.append(len(phases))
        self._phases += phases
        self.seconds += phases[-1].seconds

    def trajectory(self) -> Trajectory:
        """The whole of it."""
        start, way, begin = (
            np.repeat(np.array(each), self._counts, axis=0)
            for each in (self._from, self._ways, self._begins)
        )
        t, s, ds, dds = np.array(self._phases).T
        fields = [begin + t, start + s[:, None] * way, ds[:, None] * way, dds[:, None] * way]
        for row, turn in reversed(self._turns):
            parts = (turn.seconds, turn.positions, turn.velocities, turn.accelerations)
            fields = [
                np.concatenate([field[:row], part[1:], field[row:]])
                for field, part in zip(fields, parts, strict=True)
                if part is not None
            ]
        seconds, positions, velocities, accelerations = map(frozen, fields)
        return Trajectory(seconds, positions, velocities, accelerations)


@lru_cache(maxsize=LEGS)
def timed(velocity: float, acceleration: float, jerk: float) -> tuple[Phase, ...]:
    """The way from 0 to 1, from rest to rest, within these limits of it (1/s, 1/s^2, 1/s^3); the
    phases end after whole nanoseconds, as stamps can tell.

    Raises:
        MotionError: there is no such motion.
    """
    # what is over within phases as short is not worth it
    least = 2 * SHORTEST_PHASE
    jerk = min(jerk, acceleration / least, velocity / least**2, 0.5 / least**3)
    for _ in range(TRIALS):
        profile = _profile(velocity, acceleration, jerk)
        if not any(0 < phase < SHORTEST_PHASE for phase in profile.t):
            break
        velocity, acceleration = velocity * EASIER, acceleration * EASIER
    phases, end = [], 0.0
    for number, seconds in enumerate(profile.t, start=1):
        end += seconds
        if seconds < SHORTEST_PHASE:
            continue
        whole = round(end * SECOND) / SECOND
        late = whole - end  # less than a nanosecond
        s, ds, dds = profile.p[number], profile.v[number], profile.a[number]
        phases.append(Phase(whole, s + late * (ds + late * dds / 2), ds + late * dds, dds))
    if not phases:
        raise MotionError(f'no motion within {velocity:g}/s and {acceleration:g}/s^2 of a way')
    phases[-1] = Phase(phases[-1].seconds, 1.0, 0.0, 0.0)
    return tuple(phases)


def _profile(velocity: float, acceleration: float, jerk: float) -> ruckig.Profile:
    # objects of ruckig that are kept to the end of the process are told of as leaks
    asked = ruckig.InputParameter(1)
    asked.current_position, asked.target_position = [0.0], [1.0]
    asked.max_velocity, asked.max_acceleration = [velocity], [acceleration]
    asked.max_jerk = [jerk]
    found = ruckig.Trajectory(1)
    if ruckig.Ruckig(1).calculate(asked, found) != ruckig.Result.Working:
        raise MotionError(
            f'no motion within {velocity:g}/s, {acceleration:g}/s^2 and {jerk:g}/s^3 of a way'
        )
    return found.profiles[0][0]


def small_turns(at: Array, turns: Array, limits: Array) -> Trajectory:
    """The motion from posture `at` (n,) and back, by `turns` (n,), rad, within the `limits` (3, n)
    of velocity, acceleration and jerk.

    Joint i goes by turn_i sin^4(pi t / T) while t is within its T: position, velocity, acceleration
    and jerk begin and end at 0. The next one begins before, so that the arm never seems to stand.
    """
    needed = [
        (np.abs(turns) * peak / limit).max() ** (1 / power)
        for power, (peak, limit) in enumerate(zip(PEAKS, limits, strict=True), start=1)
    ]
    whole = max(SHORTEST_TURN, *needed)
    end = whole * (1 + NEXT_TURN * (len(turns) - 1))
    t = np.linspace(0.0, end, round(TURN_POINTS * end / whole) + 1)
    begins = NEXT_TURN * np.arange(len(turns))
    x = np.pi * np.clip(t[:, None] / whole - begins, 0.0, 1.0)
    sin, cos, rate = np.sin(x), np.cos(x), np.pi / whole
    sin[-1] = 0.0  # to the last digit
    return Trajectory(
        frozen(t),
        frozen(at + turns * sin**4),
        frozen(turns * rate * 4 * sin**3 * cos),
        frozen(turns * rate**2 * (12 * (sin * cos) ** 2 - 4 * sin**4)),
    )
