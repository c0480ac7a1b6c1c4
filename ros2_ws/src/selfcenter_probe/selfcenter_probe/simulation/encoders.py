# SPDX-License-Identifier: Apache-2.0
"""What the encoders do not see, and what they see wrongly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen


class Repeatability:
    """A small angle in every joint that stays while the joint stands and changes as it travels.

    Each is normal with standard deviation `sigma` (rad); after a travel of x rad it keeps
    exp(-x / travel) of its value and the rest is new, so that it neither jumps nor grows.
    """

    def __init__(self, sigma: float, travel: float) -> None:
        self._sigma = sigma
        self._travel = travel
        self._error: Array | None = None
        self._last: Array = np.zeros(0)

    def draw(self, postures: Array, generator: np.random.Generator) -> Array:
        """Errors (N, n), rad, of postures (N, n) far from one another, and from where the arm came
        from: of that there is an error too."""
        count, joints = postures.shape
        return self._sigma * generator.standard_normal((count + 1, joints))[1:]

    def after(self, q: Array, generator: np.random.Generator) -> Array:
        """The errors (n,) at posture q (n,), rad, coming straight from the last one asked for."""
        if self._error is None:
            self._error = self._sigma * generator.standard_normal(len(q))
        elif self._sigma and not np.array_equal(q, self._last):
            kept = np.exp(-np.abs(q - self._last) / self._travel)
            fresh = generator.standard_normal(len(q))
            self._error = kept * self._error + self._sigma * np.sqrt(1 - kept**2) * fresh
        self._last = np.array(q)
        return self._error


@dataclass(frozen=True)
class Encoders:
    """Encoders whose discs sit eccentric and oval on their axes.

    Each joint is really at what is read plus the sum over k = 1, 2 of
    cosine[k-1] cos(k q) + sine[k-1] sin(k q), both (2, n), rad.
    """

    cosine: Array
    sine: Array

    @classmethod
    def drawn(
        cls, eccentricity: float, ovality: float, joints: int, generator: np.random.Generator
    ) -> Encoders:
        """Encoders with these standard deviations (rad) of each harmonic's amplitude."""
        shape = generator.standard_normal((2, 2, joints)) / np.sqrt(2)
        scaled = np.array([eccentricity, ovality])[:, None] * shape
        return cls(frozen(scaled[0]), frozen(scaled[1]))

    def true(self, q: Array) -> Array:
        """Where the joints are when the encoders read q (N, n), rad."""
        if not (self.cosine.any() or self.sine.any()):
            return q
        turns = q[:, None, :] * np.array([1.0, 2.0])[:, None]
        error = (self.cosine * np.cos(turns) + self.sine * np.sin(turns)).sum(axis=1)
        there: Array = q + error
        return there

    def read(self, q_true: Array) -> Array:
        """What the encoders read when the joints are at `q_true` (N, n), rad."""
        q = q_true
        for _ in range(3):  # errors of 1e-3 rad shrink to nothing
            q = q_true - (self.true(q) - q)
        return q
