# SPDX-License-Identifier: Apache-2.0
"""Spheres and gauge locations told apart by where the nominal arm sees the spheres' centres.

Poses in time order are visits to places; places that stand to one another as the certificate's
spheres do are one location, and a place that does not fit begins a new one, or belongs to none.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from calib_model.arrays import Array
from calib_model.labelling.certificate_match import Certificate

NEAR = 0.010  # m: how far an arm not yet calibrated may see one sphere from itself


@dataclass(eq=False)
class Place:
    """Where a sphere was: `rows` of its poses, their mean `center` (3,), m."""

    rows: list[int]
    center: Array

    def add(self, rows: list[int], p: Array) -> None:
        """Take in further poses, all at `p` (N, 3)."""
        self.rows += rows
        self.center = p[self.rows].mean(axis=0)


@dataclass(eq=False)
class SeenLocation:
    """The places of one standing of the gauge, in the order of their first visits."""

    places: list[Place]
    last: Place | None = None  # the one visited last
    returned: int = 0  # rows of the last visit, if it came back to a place, else 0

    @property
    def centers(self) -> Array:
        """The places' centres (k, 3), m."""
        return np.array([place.center for place in self.places])


@dataclass
class Stray:
    """A place that fits no location: its distance to the nearest other, and the certified one."""

    place: Place
    seen: float = np.nan
    certified: float = np.nan

    def line(self) -> str:
        """In words."""
        where = ', '.join(f'{value:.3f}' for value in self.place.center)
        text = f'{len(self.place.rows)} poses at ({where}) m left out: they fit no sphere'
        if np.isfinite(self.seen):
            text += (
                f', {self.seen * 1e3:.1f} mm from the next one seen where the certificate has '
                f'{self.certified * 1e3:.1f} mm'
            )
        return text


@dataclass
class SphereClusters:
    """The locations in time order, and what belongs to none."""

    locations: list[SeenLocation] = field(default_factory=list)
    strays: list[Stray] = field(default_factory=list)


def visits(p: Array, near: float) -> list[list[int]]:
    """Runs of points (N, 3), in time order, that stay at one place: rows up to `near` (m) from the
    mean of those before them."""
    found: list[list[int]] = []
    center = np.full(3, np.inf)
    for row, point in enumerate(p):
        if np.linalg.norm(point - center) <= near:
            found[-1].append(row)
            center = center + (point - center) / len(found[-1])
        else:
            found.append([row])
            center = point.copy()
    return found


class SphereClustering:
    """Takes visits in time order; poses `p` (N, 3) are where the nominal arm saw the sphere, m."""

    def __init__(self, p: Array, certificate: Certificate) -> None:
        self._p = p
        self._certificate = certificate
        self.near = min(NEAR, certificate.pitch / 4)
        self.found = SphereClusters()
        self._pending: list[Place] = []

    def run(self) -> SphereClusters:
        """Group all poses."""
        for rows in visits(self._p, self.near):
            self._take(rows)
        self._strand(self._pending)
        self.found.locations = [each for each in self.found.locations if self._kept(each)]
        return self.found

    def _take(self, rows: list[int]) -> None:
        center = self._p[rows].mean(axis=0)
        current = self.found.locations[-1] if self.found.locations else None
        if current is not None and self._joined(current, rows, center):
            self._strand(self._pending)  # what came between was no new location
            self._pending = []
            return
        for place in self._pending:
            if np.linalg.norm(place.center - center) <= self.near:
                place.add(rows, self._p)
                break
        else:
            place = Place(list(rows), center)
            self._pending.append(place)
        begun = self._consistent(place)
        if len(begun) >= 2:
            self._begin(begun)

    def _joined(self, current: SeenLocation, rows: list[int], center: Array) -> bool:
        """Whether a visit is to the location the gauge stood at last."""
        for place in current.places:
            if np.linalg.norm(place.center - center) <= self.near:
                current.returned = 0 if place is current.last else len(rows)
                place.add(rows, self._p)
                current.last = place
                return True
        if not self._fits([*current.centers, center]):
            return False
        current.places.append(Place(list(rows), center))
        current.last, current.returned = current.places[-1], 0
        return True

    def _fits(self, centers: list[Array]) -> bool:
        return bool(self._certificate.matches(np.array(centers), self.near))

    def _consistent(self, newest: Place) -> list[Place]:
        """A pending place and those before it that stand to it as on the certificate.

        A single pose may be a wild one: it begins nothing.
        """
        begun = [newest] if len(newest.rows) > 1 else []
        for place in reversed(self._pending):
            if not begun or place is newest or len(place.rows) < 2:
                continue
            if self._fits([place.center, *(each.center for each in begun)]):
                begun.insert(0, place)
        return [place for place in self._pending if place in begun]

    def _begin(self, begun: list[Place]) -> None:
        self._strand([place for place in self._pending if place not in begun])
        self._pending = []
        location = SeenLocation(begun, begun[-1])
        before = self.found.locations[-1] if self.found.locations else None
        if before is not None and before.returned and before.last is not None:
            # a gauge turned about one of its spheres: that visit was the new location's first
            rows = before.last.rows[-before.returned :]
            center = self._p[rows].mean(axis=0)
            if self._fits([center, *location.centers]):
                del before.last.rows[-before.returned :]
                before.last.add([], self._p)
                location.places.insert(0, Place(list(rows), center))
        self.found.locations.append(location)

    def _strand(self, places: list[Place]) -> None:
        for place in places:
            self.found.strays.append(self._stray(place))

    def _stray(self, place: Place) -> Stray:
        others = [each for location in self.found.locations[-1:] for each in location.places]
        others += [each for each in self._pending if each is not place]
        if not others:
            return Stray(place)
        seen = min(float(np.linalg.norm(each.center - place.center)) for each in others)
        return Stray(place, seen, self._certificate.nearest_distance(seen))

    def _kept(self, location: SeenLocation) -> bool:
        """Whether any place is left once those without the two poses of a repeatability are out."""
        for place in [place for place in location.places if len(place.rows) < 2]:
            location.places.remove(place)
            self.found.strays.append(Stray(place))
        return len(location.places) >= 1
