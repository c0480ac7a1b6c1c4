# SPDX-License-Identifier: Apache-2.0
"""The motion that joint_trajectory_controller makes of a trajectory, and whether limits are kept.

Between points it interpolates linearly where positions alone are given, by cubic polynomials with
velocities, by quintic ones with accelerations. A trajectory that replaces another begins in the
state commanded at that moment (`interpolate_from_desired_state`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from calib_capture.motion.limits import MotionLimits
from calib_capture.motion.trajectory import Trajectory
from calib_model.arrays import Array, frozen

DWELL_STEP = 0.05  # s: at rest, states this near let a probe be read between them
MOTION_STEP = 5.0  # s: on the way, where nothing is measured
REST = 1e-12  # rad
SAME = 1e-6  # s: instants that need no point each
TICK = 0.004  # s of a controller: a jump of velocity is an acceleration over one
LOOKS = 9  # instants of each piece at which limits are looked at, ends included
SMOOTHED = 1e-4  # rad, a jump of position that drives do not notice
EXCESS = 1.02  # of every limit is noticed
POWERS = 6


class MotionState(NamedTuple):
    """Commanded position, velocity and acceleration (..., n), rad, rad/s, rad/s^2."""

    position: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def resting(cls, at: Array) -> MotionState:
        """At rest in a posture (..., n)."""
        return cls(at, np.zeros_like(at), np.zeros_like(at))


@dataclass(frozen=True)
class Fault:
    """The first limit that a motion breaks, and when, in s from its start."""

    seconds: float
    words: str


class InterpolatedMotion:
    """The way from a state along a trajectory, and rest at its end."""

    def __init__(self, state: MotionState, trajectory: Trajectory) -> None:
        t, q = trajectory.seconds, trajectory.positions
        v, a = trajectory.velocities, trajectory.accelerations
        if t[0] > 0:  # from where it is
            t, q = np.insert(t, 0, 0.0), np.vstack([state.position, q])
            v = v if v is None else np.vstack([state.velocity, v])
            a = a if a is None else np.vstack([state.acceleration, a])
        self.seconds, self.positions = t, q
        self._pieces = _pieces(np.diff(t)[:, None], q, v, a)
        self._start = state
        moves = np.zeros(len(t), dtype=bool)
        for field in (v, a):
            moves |= False if field is None else (field != 0).any(axis=1)
        moves[-1] = False
        self._rests = np.flatnonzero(~moves)

    @classmethod
    def resting(cls, at: Array) -> InterpolatedMotion:
        """No motion at all."""
        return cls(MotionState.resting(at), Trajectory(np.zeros(1), at[None]))

    @property
    def duration(self) -> float:
        """Seconds until the last point."""
        return float(self.seconds[-1])

    def at(self, seconds: float) -> MotionState:
        """What is commanded `seconds` after the start."""
        if seconds >= self.seconds[-1] or not len(self._pieces):
            return MotionState.resting(self.positions[-1])
        piece = max(int(np.searchsorted(self.seconds, seconds, side='right')) - 1, 0)
        since = max(seconds - float(self.seconds[piece]), 0.0)
        p, v, a, _ = derivatives(self._pieces[piece], np.array(since))
        return MotionState(p, v, a)

    def positions_at(self, seconds: Array) -> Array:
        """Commanded positions (..., n) at instants (...)."""
        return self.states_at(seconds).position

    def states_at(self, seconds: Array) -> MotionState:
        """What is commanded at instants (...), each field (..., n)."""
        if not len(self._pieces):
            there = np.broadcast_to(self.positions[-1], (*seconds.shape, self.positions.shape[1]))
            return MotionState.resting(there)
        within = np.clip(seconds, self.seconds[0], self.seconds[-1])
        piece = np.searchsorted(self.seconds, within, side='right') - 1
        piece = np.clip(piece, 0, len(self._pieces) - 1)
        p, v, a, _ = derivatives(self._pieces[piece], within - self.seconds[piece])
        return MotionState(p, v, a)

    def leg(self, seconds: float) -> tuple[Array, Array]:
        """Where it was at rest before, and where it is at rest next."""
        rests = self._rests
        after = int(np.searchsorted(self.seconds[rests], seconds, side='right'))
        before = rests[max(after - 1, 0)]
        return self.positions[before], self.positions[rests[min(after, len(rests) - 1)]]

    def turned_off(self, since: float, turn: float, stop: Trajectory) -> Trajectory:
        """The way itself from its last point before `since` on, and from `turn` on a `stop`; its
        time is that of the way."""
        first = max(int(np.searchsorted(self.seconds, since, side='right')) - 1, 0)
        kept = self.seconds[first:]
        kept = np.append(kept[kept < turn - SAME], turn)
        states = [self.at(float(seconds)) for seconds in kept]
        positions, velocities, accelerations = (
            np.array(each) for each in zip(*states, strict=True)
        )
        still = np.zeros_like(stop.positions)
        return Trajectory(
            frozen(np.append(kept, turn + stop.seconds)),
            frozen(np.vstack([positions, stop.positions])),
            frozen(np.vstack([velocities, still])),
            frozen(np.vstack([accelerations, still])),
        )

    def to_next_rest(self, since: float, seconds: float) -> Trajectory:
        """The way itself from its last point before `since` to the first rest after `seconds`."""
        after = self._rests[self.seconds[self._rests] > seconds][0]
        end = Trajectory(np.zeros(0), np.empty((0, self.positions.shape[1])))
        return self.turned_off(since, float(self.seconds[after]), end)

    def first_fault(self, limits: MotionLimits, names: tuple[str, ...]) -> Fault | None:
        """The first limit that the way breaks, at its points and between them."""
        found = list(_jumps(self.seconds[:1], self._start, self.at(0.0), limits, names))
        if len(self._pieces):
            h = np.diff(self.seconds)
            since = np.linspace(0.0, h, LOOKS, axis=1)
            p, v, a, j = derivatives(self._pieces[:, None], since)
            when = self.seconds[:-1, None] + since
            out = np.maximum(p - limits.position[:, 1], limits.position[:, 0] - p)
            nowhere = np.full(p.shape[-1], 1e-6 / EXCESS)
            for size, limit, what in (
                (out, nowhere, 'rad beyond the position limits'),
                (v, limits.velocity, 'rad/s, limit'),
                (a, limits.acceleration, 'rad/s^2, limit'),
                (j, limits.jerk, 'rad/s^3, limit'),
            ):
                found += _beyond(when, size if size is out else np.abs(size), limit, what, names)
            still = np.zeros((1, p.shape[-1]))
            ends = MotionState(p[:, -1], v[:, -1], a[:, -1])
            nexts = MotionState(
                np.vstack([p[1:, 0], self.positions[-1:]]),
                np.vstack([v[1:, 0], still]),
                np.vstack([a[1:, 0], still]),
            )
            found += _jumps(self.seconds[1:], ends, nexts, limits, names)
        return min(found, key=lambda fault: fault.seconds) if found else None

    def instants(self) -> Array:
        """Where a stepped simulation looks, s: ends of rests and motions, and a few between.

        A rest at the start is one that was looked at before. Points that are passed by without a
        rest are not looked at, but for those of a motion that comes back to where it began: it
        would not be seen.
        """
        found: list[Array] = [np.zeros(1)]
        for first, last, resting in self._stretches():
            begin, end = self.seconds[first], self.seconds[last]
            if resting and not first:
                continue
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


def _pieces(h: Array, q: Array, v: Array | None, a: Array | None) -> Array:
    """Coefficients (K - 1, 6, n) of the polynomials between points, lowest power first."""
    c = np.zeros((len(h), POWERS, q.shape[1]))
    q0, step = q[:-1], np.diff(q, axis=0)
    c[:, 0] = q0
    if v is None:
        c[:, 1] = step / h
        return c
    v0, v1 = v[:-1], v[1:]
    c[:, 1] = v0
    if a is None:
        c[:, 2] = (3 * step - (2 * v0 + v1) * h) / h**2
        c[:, 3] = ((v0 + v1) * h - 2 * step) / h**3
        return c
    before = MotionState(q0, v0, a[:-1])
    return quintic(before, MotionState(q[1:], v1, a[1:]), h)


def quintic(before: MotionState, after: MotionState, h: Array) -> Array:
    """Coefficients (..., 6, n) of the quintic polynomials that take `h` (..., 1) s from one state
    (..., n) to another, lowest power first."""
    q0, v0, a0 = before
    # what is left at the end of v0 and a0, by the powers 3, 4 and 5
    dq = after.position - q0 - v0 * h - a0 * h**2 / 2
    dv, da = (after.velocity - v0 - a0 * h) * h, (after.acceleration - a0) * h**2
    c3 = (10 * dq - 4 * dv + da / 2) / h**3
    c4 = (-15 * dq + 7 * dv - da) / h**4
    c5 = (6 * dq - 3 * dv + da / 2) / h**5
    return np.stack(np.broadcast_arrays(q0, v0, a0 / 2, c3, c4, c5), axis=-2)


def derivatives(c: Array, since: Array) -> tuple[Array, Array, Array, Array]:
    """Position and its three derivatives (..., n) of polynomials (..., 6, n) at `since` (...)."""
    s = since[..., None]
    c0, c1, c2, c3, c4, c5 = (c[..., power, :] for power in range(POWERS))
    return (
        c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
        c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5))),
        2 * c2 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5)),
        6 * c3 + s * (24 * c4 + s * 60 * c5),
    )


def _jumps(
    when: Array,
    before: MotionState,
    after: MotionState,
    limits: MotionLimits,
    names: tuple[str, ...],
) -> list[Fault]:
    """What jumps between two states (n,) or (K, n) at the same instants (K,)."""
    dq, dv, da = (np.atleast_2d(np.abs(b - a)) for a, b in zip(before, after, strict=True))
    smooth = np.full(dq.shape[1], SMOOTHED)
    return [
        *_beyond(when, dq, smooth, 'rad of jump, limit', names),
        *_beyond(
            when, dv / TICK, limits.acceleration, 'rad/s^2 in a jump of velocity, limit', names
        ),
        *_beyond(when, da / TICK, limits.jerk, 'rad/s^3 in a jump of acceleration, limit', names),
    ]


def _beyond(
    when: Array, size: Array, limit: Array, what: str, names: tuple[str, ...]
) -> list[Fault]:
    """The first of the sizes (..., n) at instants (...) that are beyond their limit (n,)."""
    size, when = size.reshape(-1, len(limit)), when.reshape(-1)
    over = size > limit * EXCESS + 1e-9
    if not over.any():
        return []
    row = int(np.argmax(over.any(axis=1)))
    joint = int(np.argmax(over[row]))
    told = f'{names[joint]}: {size[row, joint]:.3g} {what}'
    return [Fault(float(when[row]), f'{told} {limit[joint]:.3g}' if what[-5:] == 'limit' else told)]
