# SPDX-License-Identifier: Apache-2.0
"""Location after location: what came of each, and where the one gauge stands that is carried."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from calib_capture.program import PlannedPose
from calib_model.pairing import reasons_in_words


@dataclass(frozen=True)
class EndedLocation:
    """A location that is done with: of its `planned` poses so many were `taken`, and it was refused
    so many times for which reason; refused poses that spares took the place of count here too."""

    location: int
    planned: int
    taken: int
    refused: Mapping[str, int]

    @property
    def finished(self) -> bool:
        """Whether it has the poses that were asked for."""
        return self.taken >= self.planned

    def line(self) -> str:
        """Counts in words."""
        why = reasons_in_words(self.refused)
        end = '' if self.finished else 'not finished: '
        refused = f', {sum(self.refused.values())} refused ({why})' if why else ''
        return f'location {self.location}: {end}{self.taken} of {self.planned} poses taken{refused}'


class Locations:
    """Counts the poses of each location until it is done with; `ended` are those that are."""

    def __init__(self, poses: Iterable[PlannedPose]) -> None:
        self._planned = Counter(pose.location for pose in poses)
        self._taken: Counter[int] = Counter()
        self._given_up: Counter[int] = Counter()
        self._refused: dict[int, Counter[str]] = {}
        self.ended: list[EndedLocation] = []

    def plan_anew(self, poses: Iterable[PlannedPose]) -> None:
        """In place of what is left, these are planned, of locations that were not begun."""
        over = {each.location for each in self.ended}
        kept = {where: count for where, count in self._planned.items() if where in over}
        self._planned = Counter(kept) + Counter(pose.location for pose in poses)

    def take(self, location: int) -> None:
        """A pose was taken there."""
        self._taken[location] += 1
        self._count(location)

    def refuse(self, location: int, reason: str, replaced: bool) -> None:
        """A pose was refused there; another one is tried in its place if it is `replaced`."""
        self._refused.setdefault(location, Counter())[reason] += 1
        self._given_up[location] += not replaced
        self._count(location)

    def _count(self, location: int) -> None:
        planned, taken = self._planned[location], self._taken[location]
        if taken + self._given_up[location] == planned:
            refused = dict(self._refused.get(location, {}))
            self.ended.append(EndedLocation(location, planned, taken, refused))


@dataclass
class OneGauge:
    """A gauge that is carried: it stands `at` a location, or is being waited for: `to` be carried
    to the next. `leaving` tells that the arm has been sent out of its way, `clear` that the arm
    waits there."""

    at: int
    to: int | None = None
    leaving: bool = False
    clear: bool = False
    since: float = 0.0

    def wait(self, location: int, now: float, clear: bool) -> None:
        """From `now` (s) on it is to be carried to a location."""
        self.to, self.since, self.leaving, self.clear = location, now, False, clear

    def carried(self, now: float) -> float:
        """It stands where it was to be carried to; how long (s) that took."""
        assert self.to is not None
        self.at, self.to = self.to, None
        return now - self.since
