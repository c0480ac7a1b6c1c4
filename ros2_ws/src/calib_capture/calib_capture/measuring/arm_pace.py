# SPDX-License-Identifier: Apache-2.0
"""How fast the arm's time runs: a simulation may have its own."""

from __future__ import annotations

PACES = (0.01, 100.0)  # that are told apart
REAL = (0.75, 1.33)  # real time, as far as messages come in time
SURE = 0.3  # s of the arm's or the wall's time by which it is told
SET = 0.2  # s of the arm's time beyond the wall's in one step: a clock may have been set
SHORT = 0.02  # s of the wall's time: bursts come all at once


class ArmPace:
    """The arm's time in the wall's, 1.0 as long as nothing else has been seen.

    It is told while the arm moves: at rest a stepped simulation keeps real time. What earlier
    motions told holds until the one under way has lasted for long enough. One leap of the stamps
    within a motion is a clock that was set, not a pace.
    """

    def __init__(self) -> None:
        self._before: tuple[float, float] | None = None
        self.known = 1.0
        self.begin()

    def begin(self) -> None:
        """A motion begins."""
        self._arm = self._wall = 0.0  # s that have passed in it
        self._leap = 0.0  # s, the largest so far

    def see(self, seconds: float, now: float, moves: bool) -> None:
        """A joint state at `seconds` of the arm's time has come `now`, s of the wall's."""
        before, self._before = self._before, (seconds, now)
        if before is None or not moves:
            return
        arm, wall = seconds - before[0], now - before[1]
        self._arm, self._wall = self._arm + arm, self._wall + wall
        if abs(arm - wall) > max(SET, abs(self._leap)):
            self._leap = arm - wall
        arm = self._arm - self._leap
        if max(arm, self._wall) > SURE:
            pace = min(max(arm / max(self._wall, SHORT), PACES[0]), PACES[1])
            self.known = 1.0 if REAL[0] < pace < REAL[1] else pace
