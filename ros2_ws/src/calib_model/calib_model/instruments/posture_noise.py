# SPDX-License-Identifier: Apache-2.0
"""Noise of simulated instruments that is the same whenever an arm does the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol
from zlib import crc32

import numpy as np

from calib_model.arrays import Array

PLACES = 2**16  # in which visits are counted, so that an arm that moves for days fills no memory


class PostureNoise:
    """A generator for each visit of each posture.

    What is drawn depends on the seed, on where the arm stands and on how often it was there before;
    not on how long it stood elsewhere, nor on messages that were lost on the way.
    """

    def __init__(self, generator: np.random.Generator) -> None:
        self._seed = int(generator.integers(2**63))
        self._visits = np.zeros(PLACES, dtype=np.int64)

    def arriving(self, posture: Array) -> np.random.Generator:
        """The generator of an arm that comes to the posture (n,)."""
        place = crc32((posture + 0.0).tobytes())  # of -0.0 makes 0.0
        visit = int(self._visits[place % PLACES])
        self._visits[place % PLACES] += 1
        return np.random.default_rng([self._seed, place, visit])


class Normal(Protocol):
    """What noise is drawn from: a generator of numpy, or several in turn."""

    def standard_normal(self, size: tuple[int, ...], /) -> Array:
        """Standard normal numbers of that shape."""


class InTurn:
    """So many rows from each generator, one after the other: as if each had been asked alone."""

    def __init__(self, draws: Sequence[tuple[np.random.Generator, int]]) -> None:
        self._draws = draws

    def standard_normal(self, size: tuple[int, ...], /) -> Array:
        """Standard normal numbers of shape `size`, whose first is the number of all rows."""
        return np.concatenate(
            [each.standard_normal((rows, *size[1:])) for each, rows in self._draws]
        )
