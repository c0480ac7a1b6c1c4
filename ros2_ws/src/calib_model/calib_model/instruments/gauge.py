# SPDX-License-Identifier: Apache-2.0
"""The ball-bar gauge and its certificate."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError

#: where along a gauge four spheres lie: 1, 6, 10 and 14 of 15
SPREAD = (0.0, 5 / 14, 9 / 14, 13 / 14)


@dataclass(frozen=True)
class Expansion:
    """What a gauge does with temperature: `coefficient` (1/K) with its standard `uncertainty`, and
    the `reference` (deg C) that its certificate holds for."""

    coefficient: float
    uncertainty: float = 0.0
    reference: float = 20.0


@dataclass(frozen=True)
class Scale:
    """The `factor` on all certified lengths at a `temperature` (deg C), and its standard
    uncertainty."""

    temperature: float
    factor: float
    standard_uncertainty: float


@dataclass(frozen=True)
class Gauge:
    """Spheres of one diameter (m) with certified centres `(number, (x, y, z))` in the gauge frame.

    `constant` (m) and `proportional` (m/m) give the certificate's expanded uncertainty of a
    distance L: constant + proportional * L; the chapter's (1 + 0.001 L) um, L in mm. `scale` is
    what was done to them for a temperature.
    """

    name: str
    sphere_diameter: float
    spheres: tuple[tuple[int, tuple[float, float, float]], ...]
    constant: float = 0.0
    proportional: float = 0.0
    expansion: Expansion | None = None
    scale: Scale | None = None

    @property
    def numbers(self) -> tuple[int, ...]:
        """The spheres' numbers, in the certificate's order."""
        return tuple(number for number, _ in self.spheres)

    def spread(self, count: int = 4) -> tuple[int, ...]:
        """Numbers of `count` spheres far apart along the gauge, all where it has no more: 1, 6, 10
        and 14 of 15 in a row, so that no two distances between neighbours of four are the same."""
        centers = np.array([center for _, center in self.spheres])
        if len(centers) <= count:
            return self.numbers
        off = centers - centers.mean(axis=0)
        along = off @ np.linalg.svd(off)[2][0]
        order = np.argsort(along if along[0] <= 0 else -along, kind='stable')
        shares = np.interp(np.linspace(0, 1, count), np.linspace(0, 1, 4), SPREAD)
        places = np.round(shares * (len(centers) - 1)).astype(int)
        return tuple(self.numbers[order[place]] for place in dict.fromkeys(places.tolist()))

    def center(self, number: int) -> Array:
        """The certified centre (3,) of a sphere in the gauge frame, m.

        Raises:
            DataError: the certificate has no such sphere.
        """
        for known, center in self.spheres:
            if known == number:
                return frozen(center)
        there = ', '.join(map(str, self.numbers))
        raise DataError(f'{self.name}: no sphere {number} on the certificate (it has {there})')

    def distance(self, first: int, second: int) -> float:
        """The certified distance D0 between two spheres' centres, m (eq. 7).

        Raises:
            DataError: the certificate lacks one of them.
        """
        return float(np.linalg.norm(self.center(first) - self.center(second)))

    def distance_uncertainty(self, length: float) -> float:
        """The certificate's expanded (k = 2) uncertainty of a distance `length` (m), in m."""
        return self.constant + self.proportional * length

    def at(self, temperature: float, uncertainty: float = 0.0) -> Gauge:
        """The gauge at a temperature (deg C) known to a standard `uncertainty` (K). What is not
        known of its expansion is one scale error of all its lengths.

        Raises:
            DataError: its expansion is not known, or it is at some temperature already.
        """
        expansion = self.expansion
        if expansion is None or self.scale is not None:
            raise DataError(
                f'{self.name}: at {temperature:g} deg C its lengths are not known without '
                '`expansion: {coefficient, uncertainty, reference}` in its description'
            )
        above = temperature - expansion.reference
        factor = 1 + expansion.coefficient * above
        standard = math.hypot(expansion.uncertainty * above, expansion.coefficient * uncertainty)
        grown = tuple(
            (number, (factor * x, factor * y, factor * z)) for number, (x, y, z) in self.spheres
        )
        return replace(
            self,
            spheres=grown,
            proportional=math.hypot(self.proportional, 2 * standard),
            scale=Scale(temperature, factor, standard),
        )

    @property
    def temperature_uncertainty(self) -> float:
        """The standard uncertainty (K) that the temperature was given with; 0 without one."""
        if self.expansion is None or self.scale is None or not self.expansion.coefficient:
            return 0.0
        above = self.scale.temperature - self.expansion.reference
        by_coefficient = self.expansion.uncertainty * above
        left = max(self.scale.standard_uncertainty**2 - by_coefficient**2, 0.0)
        return math.sqrt(left) / abs(self.expansion.coefficient)

    def as_certified(self) -> Gauge:
        """The gauge as its certificate has it, whatever temperature it was taken at."""
        if self.scale is None:
            return self
        factor, standard = self.scale.factor, self.scale.standard_uncertainty
        shrunk = tuple(
            (number, (x / factor, y / factor, z / factor)) for number, (x, y, z) in self.spheres
        )
        left = max(self.proportional**2 - (2 * standard) ** 2, 0.0)
        return replace(self, spheres=shrunk, proportional=math.sqrt(left), scale=None)

    def pairs(self) -> list[tuple[int, int]]:
        """Every pair of sphere numbers once, in the certificate's order."""
        return list(combinations(self.numbers, 2))
