# SPDX-License-Identifier: Apache-2.0
"""From arm, probe, gauge and its places to a measuring program."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib_capture.program.candidates import (
    NO_FREE_WAY,
    Candidate,
    Candidates,
    Finder,
    Reach,
    branch_names,
    joints_of,
)
from calib_capture.program.flange_poses import FlangePoses
from calib_capture.program.pose_selection import (
    Indices,
    Information,
    Pool,
    choose,
    information_matrix,
)
from calib_capture.program.program import (
    Contacts,
    Expected,
    PlannedPose,
    Program,
    ProgramError,
    ProgramSettings,
    Router,
    SpherePlan,
    WayOut,
)
from calib_capture.program.visiting_order import Visit, VisitingOrder
from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm, Gauge, Probe, refuse_misfit
from calib_model.progress import Pace, Progress, paced
from calib_model.transforms import RigidTransform

MANY_REACHES = 10.0  # of the arm: no gauge is that large
SPARE_SHARE = 0.2
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


def refuse_other_lengths(arm: Arm, gauge: Gauge) -> None:
    """Nothing, where a gauge is of a size that the arm could probe.

    Raises:
        ProgramError: its spheres are many reaches apart, or as large: in mm, most likely.
    """
    a, _, d, *_ = np.abs(arm.geometry)
    reach = float(np.sum(a) + np.sum(d))
    centers = np.array([center for _, center in gauge.spheres])
    apart = float(np.linalg.norm(np.ptp(centers, axis=0))) if len(centers) else 0.0
    for what, size in (('spheres up to', apart), ('spheres of', gauge.sphere_diameter)):
        if size > MANY_REACHES * reach:
            more = ' apart' if size == apart else ' diameter'
            raise ProgramError(
                f'{gauge.name}: {what} {size:g} m{more}, where {arm.name} reaches {reach:.3g} m: '
                'is it in mm?'
            )


class Planner:
    """Makes programs for one arm with one probe.

    `finder` judges hands, `hands` gives them, `spheres` are those that are probed.

    Raises:
        InverseError: the arm has fewer than six joints.
        DataError: the gauge's spheres do not sit in the probe.
        ProgramError: the offsets asked for are beyond the styli's stroke.
        BodyError: the sizes given for the arm's links are not as many as it has.
    """

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge, settings: ProgramSettings) -> None:
        refuse_other_lengths(arm, gauge)
        refuse_misfit(probe, gauge)
        self.arm = arm
        self.probe = probe
        self.gauge = gauge
        self.settings = settings
        self.spheres = settings.spheres or gauge.spread()
        reach = Reach(
            settings.limit_margin, settings.singular_margin, settings.approach, settings.bodies
        )
        self.finder = Finder(arm, probe, gauge, reach)
        self.hands = FlangePoses(probe, gauge, settings, self.finder.inverse.redundant_range())
        self.information = Information(arm, probe, gauge, settings.choice)

    def program(
        self,
        placements: Mapping[int, RigidTransform],
        locations: Sequence[int] = (),
        progress: Progress | None = None,
    ) -> Program:
        """The program for `locations` (all when empty) of `placements` (`T_base_gauge`);
        `progress` hears how far it is.

        Raises:
            ProgramError: a location is not among the placements, or none of its spheres can be
                reached; says which spheres and what kept the arm from them. Or no posture keeps
                clear of the gauge at every location.
            DataError: the gauge has no such sphere.
        """
        unknown = [number for number in locations if number not in placements]
        if unknown:
            known = ', '.join(map(str, sorted(placements)))
            raise ProgramError(f'location {unknown[0]} has no place (known: {known})')
        places = {number: placements[number] for number in locations or sorted(placements)}
        self.finder.stand(tuple(placements.values()) if self.settings.standing else ())
        drafts: list[Draft] = []
        pace = Pace(progress, 'looking for postures', 'spheres')
        spheres = self.spheres
        for location, place in places.items():
            found: list[Draft] = []
            for sphere in spheres:
                pace(len(drafts) + len(found), len(places) * len(spheres))
                found.append(self.draft(place, location, sphere))
            _refuse_out_of_reach(self.arm, location, found)
            drafts += found
        pace.end()
        pools = [self.pool(places[draft.location], draft) for draft in drafts]
        chosen = choose(self.information, pools, self.settings.poses_per_sphere).chosen
        picked = [
            [draft.candidates.found[i] for i in rows]
            for draft, rows in zip(drafts, chosen, strict=True)
        ]
        rest = self._rest(places) if self.settings.by_approach else self._home()
        plans, visited = self._plans(places, drafts, picked, rest, progress)
        kept = [rows[items] for rows, items in zip(chosen, visited, strict=True)]
        return Program(
            plans,
            self._expected(pools, kept),
            self._router(places),
            self._contacts(places),
            frozen(rest),
            self._way_out(places, rest),
        )

    def draft(self, T_base_gauge: RigidTransform, location: int, sphere: int) -> Draft:
        """The candidates of one sphere."""
        settings = self.settings
        self.finder.put_gauge(T_base_gauge, sphere)
        key = (settings.seed, location, sphere)
        hands = self.hands.around(T_base_gauge, sphere, key)
        found = self.finder.find(hands, settings.pool * settings.poses_per_sphere)
        # where the gauge is not quite where it should be, offsets are what takes spheres too far
        hands = self.hands.around(T_base_gauge, sphere, (*key, 1), offset_share=0.2)
        planned = min(len(found.found), settings.poses_per_sphere)
        spare = self.finder.find(hands, math.ceil(SPARE_SHARE * planned))
        return Draft(location, sphere, found, spare)

    def pool(self, T_base_gauge: RigidTransform, draft: Draft) -> Pool:
        """What the candidates of one sphere tell."""
        found = draft.candidates.found
        center = T_base_gauge.apply(self.gauge.center(draft.sphere))
        joints = joints_of(found, self.arm.n)
        seats = np.array([each.p_probe_sphere for each in found]).reshape(-1, 3)
        return Pool(draft.location, draft.sphere, center, self.information.rows(joints, seats))

    def _expected(self, pools: Sequence[Pool], chosen: Sequence[Indices]) -> Expected:
        information = self.information
        return Expected(
            information.position_uncertainty(information.known),
            information.position_uncertainty(information_matrix(information, pools, chosen)),
        )

    def _plans(
        self,
        places: Mapping[int, RigidTransform],
        drafts: Sequence[Draft],
        picked: Sequence[Sequence[Candidate]],
        rest: Array,
        progress: Progress | None = None,
    ) -> tuple[tuple[SpherePlan, ...], list[Indices]]:
        """One sphere after the other; from location to location by a posture of `rest` that
        is clear of the gauge at all of them. And which of the picked are visited."""
        driven = self.settings.by_approach
        visiting = VisitingOrder(self.arm.velocity, self.finder.ways if driven else None, rest)
        plans: list[SpherePlan] = []
        visited: list[Indices] = []
        trail: list[Array] = []  # since the posture of rest
        at = drafts[0].location if drafts else 0
        todo = list(zip(drafts, picked, strict=True))
        for draft, candidates in paced(todo, progress, 'finding free ways', 'spheres'):
            back: Array = np.empty((0, self.arm.n))
            if driven and draft.location != at:
                back = self._back(visiting.here, rest, trail)
                visiting.here, trail = rest, []
            at = draft.location
            self.finder.put_gauge(places[at], draft.sphere)
            visits = visiting.visit(candidates)
            trail += [visit.way for visit in visits]
            plans.append(self._plan(draft, candidates, visits, back))
            visited.append(np.array([visit.item for visit in visits], dtype=np.int64))
        return tuple(plans), visited

    def _home(self) -> Array:
        limits = self.arm.ranges
        middle: Array = limits.mean(axis=1)
        return middle

    def _rest(self, places: Mapping[int, RigidTransform]) -> Array:
        """A posture that keeps clear of the gauge wherever it comes to stand, and out of the way
        of whoever carries it."""
        generator = np.random.default_rng(self.settings.seed)
        lower, upper = self.arm.ranges.T
        tried, best, off, trials = self._home(), None, 0.0, REST_TRIALS
        while trials:
            if all(self._clear(tried, place) for place in places.values()):
                gap = min(self._gap(tried, place) for place in places.values())
                if gap >= OUT_OF_THE_WAY:
                    return tried
                trials = min(trials, MORE_TRIALS)
                best, off = (tried, gap) if best is None or gap > off else (best, off)
            tried, trials = generator.uniform(lower, upper), trials - 1
        if best is None:
            raise ProgramError(
                f'{self.arm.name}: found no posture that is clear of the gauge at every location'
            )
        return best

    def _clear(self, q: Array, place: RigidTransform) -> bool:
        self.finder.put_gauge(place)
        return self.finder.ways.clear(q)

    def _gap(self, q: Array, place: RigidTransform) -> float:
        self.finder.put_gauge(place)
        return self.finder.gap(q)

    def _back(self, here: Array, rest: Array, trail: Sequence[Array]) -> Array:
        """The way (K, n) from `here` to `rest`, ends included; the gauge is where it was put.

        Where none is found it leads back by the ways of the location, its `trail`.
        """
        between = self.finder.ways.between(here, rest)
        if between is None:
            between = self.finder.ways.retraced(np.vstack([rest, *trail, here]))
        return np.vstack([here, between])

    def _plan(
        self, draft: Draft, candidates: Sequence[Candidate], visits: Sequence[Visit], back: Array
    ) -> SpherePlan:
        names = branch_names(self.arm, joints_of(candidates, self.arm.n))
        poses = []
        for number, visit in enumerate(visits):
            way = np.vstack([back, visit.way]) if number == 0 else visit.way
            candidate, branch = candidates[visit.item], names[visit.item]
            poses.append(self._planned(draft, candidate, visit.which, way, branch))
        missed = set(range(len(candidates))) - {visit.item for visit in visits}
        refused = draft.candidates.refusals(self.arm)
        refused.update(Counter((names[item], NO_FREE_WAY) for item in missed))
        none = np.empty((0, self.arm.n))
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
        joints, settings = candidate.postures[which], self.settings
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

    def _router(self, places: Mapping[int, RigidTransform]) -> Router | None:
        """FreePaths to a pose from where the program did not foresee the arm to be."""
        if not self.settings.by_approach:
            return None

        def way_to(start: Array, pose: PlannedPose) -> Array | None:
            self.finder.put_gauge(places[pose.location], pose.sphere)
            return self.finder.way_from(start, pose.approach[0])

        return way_to

    def _way_out(self, places: Mapping[int, RigidTransform], rest: Array) -> WayOut | None:
        """FreePaths away from the gauge of a location."""
        if not self.settings.by_approach:
            return None

        def way_out(start: Array, location: int) -> Array | None:
            self.finder.put_gauge(places[location])
            return self.finder.way_from(start, rest)

        return way_out

    def _contacts(self, places: Mapping[int, RigidTransform]) -> Contacts:
        """What keeps the arm from getting away from where it stands."""

        def touching(here: Array, pose: PlannedPose) -> str:
            self.finder.put_gauge(places[pose.location], pose.sphere)
            return self.finder.contact(here)

        return touching


def _refuse_out_of_reach(arm: Arm, location: int, drafts: Sequence[Draft]) -> None:
    """Refuse a location where the gauge cannot be probed at all."""
    if any(draft.candidates.found for draft in drafts):
        return
    told = []
    for draft in drafts:
        why = ', '.join(reason for reason, _ in draft.candidates.reasons().most_common(2))
        told.append(f'{draft.sphere} ({why})')
    raise ProgramError(
        f'location {location}: none of the chosen spheres can be reached by {arm.name}: '
        f'sphere {", ".join(told)}'
    )
