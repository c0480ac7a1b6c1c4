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
    and targets, and by what its own points are off, of covariance `own` (6, 6); `common` (G, 6) is
    that of the errors of parameters and targets with the latter."""

    number: int
    along: Array
    own: Array
    common: Array


@dataclass(frozen=True)
class PlaceShares:
    """The errors of G = F + 6 K columns: the free parameters and small motions of K targets.

    `noise` (G, G): covariance by what single points are off; the true parameters being off nominal
    by b (F,) makes an error of `prior` (G, F) times b. What stations' own points are off is
    independent from station to station.
    `unit_sigma`, m, is what was stated of a point that scatters as all is said to here, 0 where
    nothing was. `scatter` has targets and stations whose points have so many times the variance
    of all, where they scatter otherwise.
    """

    targets: tuple[str, ...]
    noise: Array
    prior: Array
    stations: tuple[StationShare, ...]
    unit_sigma: float = 0.0
    scatter: tuple[tuple[str, int, float], ...] = ()

    def times(self, target: str, station: int) -> float:
        """How many times the variance of all a point has: as those of its target and station, or,
        where it is seen from elsewhere, as those of its target on average."""
        own = [times for name, number, times in self.scatter if (name, number) == (target, station)]
        own = own or [times for name, _, times in self.scatter if name == target]
        return float(np.mean(own)) if own else 1.0

    @classmethod
    def of(
        cls,
        normal: Array,
        information: Array,
        gradient: Array,
        targets: tuple[str, ...],
        stations: tuple[int, ...],
        unit_sigma: float,
        scatter: tuple[tuple[str, int, float], ...] = (),
    ) -> PlaceShares:
        """From J'J (F + 6 K + 6 S) of all columns, what the prior weighs (F,) beside it, and the
        covariance of the gradient by what the points are off."""
        free = len(information)
        known = free + 6 * len(targets)
        left, spread = normal[:known, :known].copy(), gradient[:known, :known].copy()
        told: list[tuple[int, Array, Array, Array, Array]] = []
        for row, number in enumerate(stations):
            own = slice(known + 6 * row, known + 6 * row + 6)
            inverse = full_inverse(normal[own, own])[0]
            along = -inverse @ normal[own, :known]
            left += normal[:known, own] @ along
            # the gradient with the station at its best, and how it goes with the station's own
            common = gradient[:known, own] + along.T @ gradient[own, own]
            spread += along.T @ gradient[own, :known] + common @ along
            told.append((number, along, inverse, gradient[own, own], common))
        held = left.copy()
        held[np.arange(free), np.arange(free)] += information
        inverse = full_inverse(held)[0]
        prior = (inverse @ left)[:, :free] - np.eye(known, free)
        found = tuple(
            StationShare(number, along, of_own @ own @ of_own, inverse @ common @ of_own)
            for number, along, of_own, own, common in told
        )
        return cls(targets, inverse @ spread @ inverse, prior, found, unit_sigma, scatter)
