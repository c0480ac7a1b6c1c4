# SPDX-License-Identifier: Apache-2.0
"""A trajectory in the making, move by move."""

from __future__ import annotations

from calib_capture.order import travel_time
from calib_model.rotation import Array

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
