# SPDX-License-Identifier: Apache-2.0
"""From arm, probe, gauge and its places to a measuring program."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from calib_capture.program.candidates import (
    Finder,
    Reach,
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
    WayOut,
)
from calib_capture.program.tour import Draft, Tour
from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe, refuse_misfit
from calib_model.progress import Pace, Progress
from calib_model.transforms import RigidTransform

MANY_REACHES = 10.0  # of the arm: no gauge is that large
SPARE_SHARE = 0.2


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
        drafts = self._drafts(places, progress)
        pools = [self.pool(places[draft.location], draft) for draft in drafts]
        chosen = choose(self.information, pools, self.settings.poses_per_sphere).chosen
        picked = [
            [draft.candidates.found[i] for i in rows]
            for draft, rows in zip(drafts, chosen, strict=True)
        ]
        tour = Tour(self.arm, self.finder, self.settings, places)
        plans, visited = tour.through(drafts, picked, progress)
        kept = [rows[items] for rows, items in zip(chosen, visited, strict=True)]
        return Program(
            plans,
            self._expected(pools, kept),
            self._router(places),
            self._contacts(places),
            tour.rest,
            self._way_out(places, tour.rest),
        )

    def _drafts(
        self, places: Mapping[int, RigidTransform], progress: Progress | None
    ) -> list[Draft]:
        drafts: list[Draft] = []
        pace = Pace(progress, 'looking for postures', 'spheres')
        for location, place in places.items():
            found: list[Draft] = []
            for sphere in self.spheres:
                pace(len(drafts) + len(found), len(places) * len(self.spheres))
                found.append(self.draft(place, location, sphere))
            _refuse_out_of_reach(self.arm, location, found)
            drafts += found
        pace.end()
        return drafts

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
