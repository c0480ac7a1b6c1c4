# SPDX-License-Identifier: Apache-2.0
"""What the encoders do not see: the arm never quite returns to where its joints say it is."""

from __future__ import annotations

import numpy as np

from calib_model.rotation import Array


class Repeatability:
    """A small angle in every joint that stays while the joint stands and changes as it travels.

    Each is normal with standard deviation `sigma` (rad); after a travel of x rad it keeps
    exp(-x / travel) of its value and the rest is new, so that it neither jumps nor grows.
    """

    def __init__(
        self, sigma: float, travel: float, joints: int, generator: np.random.Generator
    ) -> None:
        self._sigma = sigma
        self._travel = travel
        self._generator = generator
        self._error = self.draw(1, joints)[0]
        self._last: Array | None = None

    def draw(self, count: int, joints: int) -> Array:
        """Errors (count, joints) of postures far from one another, rad."""
        return self._sigma * self._generator.standard_normal((count, joints))

    def after(self, q: Array) -> Array:
        """The errors (n,) at posture q (n,), rad, coming straight from the last one asked for."""
        if self._sigma == 0.0:
            return self._error
        if self._last is not None and not np.array_equal(q, self._last):
            kept = np.exp(-np.abs(q - self._last) / self._travel)
            fresh = self._generator.standard_normal(len(q))
            self._error = kept * self._error + self._sigma * np.sqrt(1 - kept**2) * fresh
        self._last = np.array(q)
        return self._error
