# SPDX-License-Identifier: Apache-2.0
"""What the arm was told to do, where it is by now, and how to stop it there."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_capture.measuring.arm_pace import ArmPace
from calib_capture.motion import (
    InterpolatedMotion,
    MotionLimits,
    MotionState,
    Trajectory,
    gentlest,
    stop,
)
from calib_model.arrays import Array, frozen
from calib_model.stamps import SECOND

LEAD = 0.5  # s before a trajectory begins, where the arm shares our clock
#: whose clock tells when a trajectory begins: ours where joint states are stamped by it, theirs, or
#: nobody's
AUTO, JOINTS, NONE = 'auto', 'joints', 'none'
BEAT = SECOND // 20  # ns: it begins at a whole multiple, so the same program is read alike
AHEAD = 0.2  # s before a stop turns off the way that was commanded with a stamp
SHARED, LATE = 0.4, 1.0  # s that stamps may be off our clock when the first and any message comes
TURNS = np.arange(0.0, 0.6, 0.04)  # s after AHEAD: where a stop may turn off
ARRIVED = 1e-4  # rad from the end, where it has come to rest
HELD = 0.1  # s to stay where it is
UNSURE = 0.06  # s, how late a stop may be taken, and how far drives may be behind
LATEST = 1.5  # s, how far behind its command an arm is looked for
LOOKS, CLOSER = 0.02, 0.002  # s between places where it is looked for, and then around the best
FAR = 0.05  # rad that an arm is behind which does not follow
ALIKE = 2e-3  # rad, root mean square: places that cannot be told apart
TRACK, APART = 150, 0.01  # joint states that tell, and s between them
LONG = 1.0  # s by which stamps do not fall but with their clock
PATIENCE = 0.3  # s for a moment at which it can be stopped within its limits for sure
HASTE = 0.45  # s until it is stopped as gently as can be, within them or not


class CommandedMotion:
    """The arm's time is that of its stamps; between them it goes on as the wall's.

    Where stamps are of our own clock, or somebody says that they are of the controller's, a
    trajectory begins at a stamp, and what is commanded at any instant is known: a stop says the
    same of what is left of the way, turns off it a little later, and is within the limits whenever
    it comes until then. Else it is known only from where the joints are, and a stop has to fit all
    states in which the arm may be.
    """

    def __init__(self, limits: MotionLimits, stamps: str = AUTO) -> None:
        self._limits, self._stamps = limits, stamps
        self._motion: InterpolatedMotion | None = None
        self._pace = ArmPace()
        self._begins = 0.0  # s of the arm's time
        self._stamp, self._apart, self._newest_apart = 0, np.inf, np.inf
        self._seen = (0.0, 0.0)
        self._track: deque[tuple[float, float, Array]] = deque(maxlen=TRACK)
        self._asked: float | None = None
        self._rests_at = 0.0  # s of the arm's time, after a stop

    def see(self, joints: Array, stamp: int, now: float, wall: int = 0) -> None:
        """The joints (n,) at a stamp (ns) that has come `now` (s), when our own clock said `wall`
        (ns, 0: nobody knows)."""
        self._newest_apart = abs(stamp - wall) / SECOND if wall else np.inf
        self._apart = min(self._apart, self._newest_apart)
        self._seen = seconds, _ = stamp / SECOND, now
        self._pace.see(seconds, now, self._moving(seconds))
        if self._track and seconds < self._track[-1][0] - LONG:  # a clock was set back
            self._track.clear()
            self._rests_at = 0.0
        if not self._track or seconds - self._track[-1][0] >= APART:
            self._track.append((seconds, now, joints))

    def _moving(self, seconds: float) -> bool:
        motion = self._motion
        return motion is not None and 0.0 <= seconds - self._begins <= motion.duration

    def begin(self, trajectory: Trajectory, now: float) -> Trajectory:
        """The trajectory as it is to be sent, to an arm at rest where it begins."""
        self._motion = InterpolatedMotion(MotionState.resting(trajectory.positions[0]), trajectory)
        self._asked = None
        shared = self._stamps == JOINTS
        if self._stamps == AUTO:
            shared = self._apart < SHARED and self._newest_apart < LATE
        self._begins, self._stamp = self._arm_time(now, 1.0), 0
        if shared:
            self._stamp = -(-round((self._begins + LEAD) * SECOND) // BEAT) * BEAT
            self._begins = self._stamp / SECOND
        self._pace.begin()
        self._apart = np.inf
        self._track.clear()
        return replace(trajectory, stamp=self._stamp)

    def _arm_time(self, now: float, pace: float) -> float:
        """In real time by the states that came the fastest: others have waited on their way."""
        seen = [self._seen]
        if pace == 1.0:
            seen += [(stamp, wall) for stamp, wall, _ in self._track]
        return max(stamp + (now - wall) * pace for stamp, wall in seen)

    def elapsed(self, now: float) -> float:
        """Seconds of the arm's time since the trajectory began."""
        return self._arm_time(now, self._pace.known) - self._begins

    def under_way(self, now: float) -> bool:
        """Whether a trajectory is not over yet."""
        motion = self._motion
        if motion is None or self._there(motion):
            return False
        return self.elapsed(now) < motion.duration + UNSURE * self._pace.known

    def ought_to_move(self, now: float, seconds: float) -> bool:
        """Whether the way went on for all of so many seconds, and far from where the arm is."""
        motion, here = self._motion, self._track[-1][2] if self._track else None
        if motion is None or here is None or self._pace.known != 1.0 or not self.under_way(now):
            return False
        way = motion.positions_at(self.elapsed(now) - np.array([seconds, 0.0]))
        return bool(min(np.abs(way[0] - way[1]).max(), np.abs(way - here).max(axis=1).min()) > FAR)

    def _there(self, motion: InterpolatedMotion) -> bool:
        """Whether the arm has been seen at the end, when it was to be there: a simulation may be
        far ahead of the wall's time."""
        if not self._track or self._seen[0] < self._begins + motion.duration:
            return False
        return bool(np.abs(self._track[-1][2] - motion.positions[-1]).max() < ARRIVED)

    def forget(self) -> None:
        """Nothing is commanded any more: the arm has been started anew."""
        self._motion = None

    @property
    def stopped(self) -> bool:
        """Whether the arm has had the time to come to rest since it was stopped."""
        return self._seen[0] >= self._rests_at

    def stop(self, now: float) -> Trajectory | None:
        """How to stop the arm now; None for a moment at which it has to wait: it is to be asked
        again."""
        motion = self._motion
        if motion is None or not self._track:
            return None
        if self._pace.known != 1.0:  # a simulation, far from where it was seen: it rests by itself
            return None
        if self._stamp and self._keeps_stamps():
            return self._turned_off(motion, self._arm_time(now, 1.0) - self._begins)
        self._asked = now if self._asked is None else self._asked
        elapsed, (least, most, behind) = self.elapsed(now), self._behind()
        found = stop(motion, elapsed - most, elapsed - least + UNSURE, self._limits)
        if found is None and now - self._asked > PATIENCE:
            likely = elapsed - behind + UNSURE / 2
            found = stop(motion, likely, likely, self._limits)
            if found is None and now - self._asked > HASTE:
                found = gentlest(motion, likely, self._limits)
        if found is not None:
            self._motion = None
            self._rests_at = self._arm_time(now, 1.0) + found.duration + most + UNSURE
        return found

    def _turned_off(self, motion: InterpolatedMotion, elapsed: float) -> Trajectory | None:
        """The way as it was commanded, and a stop a little later; None where it ends before."""
        since, turn = elapsed - AHEAD, elapsed + AHEAD
        if turn >= motion.duration:
            return None
        if turn <= 0:  # it has not begun
            found = motion.turned_off(turn, turn, _held(motion.positions[0]))
        else:
            found = motion.to_next_rest(since, turn)
            for later in turn + TURNS[turn + TURNS < found.duration]:
                if (off := stop(motion, later, later, self._limits)) is not None:
                    found = motion.turned_off(since, later, off)
                    break
        self._motion, first = None, float(found.seconds[0])
        self._rests_at = self._begins + found.duration + UNSURE
        stamp = self._stamp + round(first * SECOND)
        return replace(found, seconds=frozen(found.seconds - first), stamp=stamp)

    def _keeps_stamps(self) -> bool:
        """Whether the arm has not begun at once, as if no stamp had been given."""
        stamps, joints = self._seen_since()
        early, timely = (
            self._off(lags, stamps, joints).min()
            for lags in (np.arange(-LEAD, -LEAD / 2, LOOKS), np.arange(-LEAD / 4, LEAD, LOOKS))
        )
        return bool(timely <= early + ALIKE)

    def _seen_since(self) -> tuple[Array, Array]:
        """Instants (K,), s after the start, and joints (K, n) then."""
        stamps = np.array([stamp for stamp, _, _ in self._track]) - self._begins
        return stamps, np.array([joints for _, _, joints in self._track])

    def _behind(self) -> tuple[float, float, float]:
        """By how much (s), at least, at most and most likely, the joints are behind the command as
        it was sent.

        A controller takes a while to begin, drives take one to follow; of an arm that has not
        moved yet nobody knows.
        """
        stamps, joints = self._seen_since()
        lags = np.arange(-LEAD if self._stamp else 0.0, LATEST, LOOKS)
        rms = self._off(lags, stamps, joints)
        around = rms <= rms.min() + max(ALIKE, 0.5 * float(rms.min()))
        around[max(int(np.argmin(rms)) - 1, 0) : int(np.argmin(rms)) + 2] = True
        first, last = lags[around][[0, -1]]
        lags = np.arange(first, last + CLOSER, CLOSER)
        rms = self._off(lags, stamps, joints)
        alike = lags[rms <= rms.min() + ALIKE]
        return float(alike[0]), float(alike[-1]), float(lags[np.argmin(rms)])

    def _off(self, lags: NDArray[np.floating[Any]], stamps: Array, joints: Array) -> Array:
        """How far the joints (K, n) at stamps (K,) are off the command, root mean square, if they
        are behind by lags (L,)."""
        assert self._motion is not None
        then = np.maximum(stamps[None] - lags[:, None], 0.0)
        off = np.abs(self._motion.positions_at(then) - joints).max(axis=-1)
        rms: Array = np.sqrt(np.mean(off**2, axis=1))
        return rms


def _held(posture: Array) -> Trajectory:
    """To stay in a posture (n,)."""
    return Trajectory(frozen([HELD]), frozen(posture[None]))
