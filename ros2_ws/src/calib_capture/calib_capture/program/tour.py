# SPDX-License-Identifier: Apache-2.0
"""Sphere after sphere, location after location: in which order, and by which ways."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib_capture.program.candidates import (
    NO_FREE_WAY,
    Candidate,
    Candidates,
    Finder,
    branch_names,
    joints_of,
)
from calib_capture.program.pose_selection import Indices
from calib_capture.program.program import PlannedPose, ProgramError, ProgramSettings, SpherePlan
from calib_capture.program.visiting_order import Visit, VisitingOrder
from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm
from calib_model.progress import Progress, paced
from calib_model.transforms import RigidTransform

REST_TRIALS = 2000
OUT_OF_THE_WAY = 0.1  # m off the gauge that a posture of rest is, where there is one
MORE_TRIALS = 200  # for one after one that is but clear of the gauge


@dataclass(frozen=True)
class Draft:
    """A sphere on its way into the program: what there is to choose from."""

    location: int
    sphere: int
    candidates: Candidates
    spares: Candidates


class Tour:
    """Visits what was picked of the drafts, in an order and by ways that are free.

    It begins in the posture `rest` (n,). Where the arm is driven by the approach that is clear of
    the gauge at all `places` (`T_base_gauge` by location), and the tour leads back there before
    each next location.

    Raises:
        ProgramError: no posture keeps clear of the gauge at all places.
    """

    def __init__(
        self,
        arm: Arm,
        finder: Finder,
        settings: ProgramSettings,
        places: Mapping[int, RigidTransform],
    ) -> None:
        self._arm, self._finder, self._settings = arm, finder, settings
        self._places = places
        self.rest = frozen(self._clear_of_all() if settings.by_approach else self._middle())

    def through(
        self,
        drafts: Sequence[Draft],
        picked: Sequence[Sequence[Candidate]],
        progress: Progress | None = None,
    ) -> tuple[tuple[SpherePlan, ...], list[Indices]]:
        """One sphere after the other, and which of the picked are visited."""
        driven, rest = self._settings.by_approach, self.rest
        visiting = VisitingOrder(self._arm.velocity, self._finder.ways if driven else None, rest)
        plans: list[SpherePlan] = []
        visited: list[Indices] = []
        trail: list[Array] = []  # since the posture of rest
        at = drafts[0].location if drafts else 0
        todo = list(zip(drafts, picked, strict=True))
        for draft, candidates in paced(todo, progress, 'finding free ways', 'spheres'):
            back: Array = np.empty((0, self._arm.n))
            if driven and draft.location != at:
                back = self._back(visiting.here, trail)
                visiting.here, trail = rest, []
            at = draft.location
            self._finder.put_gauge(self._places[at], draft.sphere)
            visits = visiting.visit(candidates)
            trail += [visit.way for visit in visits]
            plans.append(self._plan(draft, candidates, visits, back))
            visited.append(np.array([visit.item for visit in visits], dtype=np.int64))
        return tuple(plans), visited

    def _middle(self) -> Array:
        middle: Array = self._arm.ranges.mean(axis=1)
        return middle

    def _clear_of_all(self) -> Array:
        """A posture that keeps clear of the gauge wherever it comes to stand, and out of the way
        of whoever carries it."""
        generator = np.random.default_rng(self._settings.seed)
        lower, upper = self._arm.ranges.T
        tried, best, off, trials = self._middle(), None, 0.0, REST_TRIALS
        while trials:
            if all(self._clear(tried, place) for place in self._places.values()):
                gap = min(self._gap(tried, place) for place in self._places.values())
                if gap >= OUT_OF_THE_WAY:
                    return tried
                trials = min(trials, MORE_TRIALS)
                best, off = (tried, gap) if best is None or gap > off else (best, off)
            tried, trials = generator.uniform(lower, upper), trials - 1
        if best is None:
            raise ProgramError(
                f'{self._arm.name}: found no posture that is clear of the gauge at every location'
            )
        return best

    def _clear(self, q: Array, place: RigidTransform) -> bool:
        self._finder.put_gauge(place)
        return self._finder.ways.clear(q)

    def _gap(self, q: Array, place: RigidTransform) -> float:
        self._finder.put_gauge(place)
        return self._finder.gap(q)

    def _back(self, here: Array, trail: Sequence[Array]) -> Array:
        """The way (K, n) from `here` to rest, ends included; the gauge is where it was put.

        Where none is found it leads back by the ways of the location, its `trail`.
        """
        between = self._finder.ways.between(here, self.rest)
        if between is None:
            between = self._finder.ways.retraced(np.vstack([self.rest, *trail, here]))
        return np.vstack([here, between])

    def _plan(
        self, draft: Draft, candidates: Sequence[Candidate], visits: Sequence[Visit], back: Array
    ) -> SpherePlan:
        names = branch_names(self._arm, joints_of(candidates, self._arm.n))
        poses = []
        for number, visit in enumerate(visits):
            way = np.vstack([back, visit.way]) if number == 0 else visit.way
            candidate, branch = candidates[visit.item], names[visit.item]
            poses.append(self._planned(draft, candidate, visit.which, way, branch))
        missed = set(range(len(candidates))) - {visit.item for visit in visits}
        refused = draft.candidates.refusals(self._arm)
        refused.update(Counter((names[item], NO_FREE_WAY) for item in missed))
        none = np.empty((0, self._arm.n))
        spares = tuple(self._planned(draft, each, 0, none) for each in draft.spares.found)
        return SpherePlan(
            draft.location,
            draft.sphere,
            tuple(poses),
            spares if poses else (),
            draft.candidates.tried,
            draft.candidates.unreachable,
            refused,
        )

    def _planned(
        self, draft: Draft, candidate: Candidate, which: int, way: Array, branch: str = ''
    ) -> PlannedPose:
        joints, settings = candidate.postures[which], self._settings
        steps = candidate.way[::-1] if settings.by_approach else candidate.way[:0]
        return PlannedPose(
            draft.location,
            draft.sphere,
            frozen(joints),
            frozen(candidate.p_probe_sphere),
            frozen(joints + steps),
            branch,
            frozen(way),
            settings.approach if len(steps) else 0.0,
        )
