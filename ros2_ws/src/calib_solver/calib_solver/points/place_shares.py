# SPDX-License-Identifier: Apache-2.0
"""Where the errors of targets and stations come from: what they share with the parameters, and
what is theirs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting import full_inverse


@dataclass(frozen=True)
class StationShare:
    """A station's motion (6,), m and rad, is off by `along` (6, G) times the errors of parameters
    and targets, and by noise of its own points, of covariance `own` (6, 6)."""

    number: int
    along: Array
    own: Array


@dataclass(frozen=True)
class PlaceShares:
    """The errors of G = F + 6 K columns: the free parameters and small motions of K targets.

    `noise` (G, G): covariance by what single points are off; the true parameters being off nominal
    by b (F,) makes an error of `prior` (G, F) times b. Given these, stations err independently.
    `unit_sigma`, m, is what was stated of a point that scatters as all is said to here, 0 where
    nothing was.
    """

    targets: tuple[str, ...]
    noise: Array
    prior: Array
    stations: tuple[StationShare, ...]
    unit_sigma: float = 0.0

    @classmethod
    def of(
        cls,
        normal: Array,
        information: Array,
        noise: float,
        targets: tuple[str, ...],
        stations: tuple[int, ...],
        unit_sigma: float,
    ) -> PlaceShares:
        """From J'J (F + 6 K + 6 S) of all columns, what the prior weighs (F,) beside it, and the
        variance of a coordinate, m^2."""
        free = len(information)
        known = free + 6 * len(targets)
        left, found = normal[:known, :known].copy(), []
        for row, number in enumerate(stations):
            own = slice(known + 6 * row, known + 6 * row + 6)
            inverse = full_inverse(normal[own, own])[0]
            along = -inverse @ normal[own, :known]
            left += normal[:known, own] @ along
            found.append(StationShare(number, along, noise * inverse))
        held = left.copy()
        held[np.arange(free), np.arange(free)] += information
        inverse = full_inverse(held)[0]
        prior = (inverse @ left)[:, :free] - np.eye(known, free)
        noise_share = noise * inverse @ left @ inverse
        return cls(targets, noise_share, prior, tuple(found), unit_sigma)
