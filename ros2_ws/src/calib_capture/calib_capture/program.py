# SPDX-License-Identifier: Apache-2.0
"""The measuring program: in which postures the arm probes which sphere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib_capture.bodies import BodySettings
from calib_capture.candidates import (
    Candidate,
    Candidates,
    Finder,
    Hand,
    Reach,
    branch_names,
    joints_of,
)
from calib_capture.choice import (
    ChoiceSettings,
    Indices,
    Pool,
    Telling,
    choose,
    information_of,
)
from calib_capture.order import short_order
from calib_capture.orientations import (
    cap_directions,
    even_sequence,
    looking_along,
    sphere_directions,
)
from calib_model.arm import Arm
from calib_model.errors import CalibrationError
from calib_model.gauge import Gauge
from calib_model.probe import ActiveProbe, Probe
from calib_model.rotation import Array, RigidTransform, frozen

# one number each for: direction (2), spin, offset (2), its length, redundant joint
CHOICES = 7
TRIES_PER_POSE = 40
SPARE_SHARE = 0.2


class ProgramError(CalibrationError):
    """A measuring program that cannot be made for this arm, gauge and place."""


@dataclass(frozen=True)
class ProgramSettings:
    """What the program is asked for.

    `cap` (rad) is the half angle of the cap of directions from which a sphere is probed, around
    the gauge's z axis. `offset` (m) is the range of lengths by which the sphere is held off the
    probe's centre: without it eq. 15 has no rank. `limit_margin` (rad) keeps off joint limits,
    `singular_margin` (see `approach.singular_margin`) off singular postures. `approach` (m) is the
    way along the probe's axis that must be free before every pose; with `drive_approach` the arm
    comes and goes by it, otherwise straight from pose to pose. `bodies` None leaves collisions
    unchecked. `pool` is how many candidates there are for every pose: the most telling ones are
    taken, with 1 the first that are found.
    """

    spheres: tuple[int, ...] = (1, 6, 10, 14)
    poses_per_sphere: int = 60
    cap: float = np.radians(70.0)
    offset: tuple[float, float] = (0.0010, 0.0015)
    limit_margin: float = np.radians(1.0)
    singular_margin: float = 0.01
    approach: float = 0.03
    drive_approach: bool = False
    bodies: BodySettings | None = BodySettings()
    pool: int = 1
    choice: ChoiceSettings = ChoiceSettings()
    seed: int = 1


@dataclass(frozen=True)
class PlannedPose:
    """One posture (n,) in rad that brings the sphere to `p_probe_sphere` (3,), m.

    `approach` (S, n) are the postures to come by, the farthest first, and to leave by in reverse;
    empty where the arm is to go straight to the pose. `branch` is told by three signs.
    """

    location: int
    sphere: int
    joints: Array
    p_probe_sphere: Array
    approach: Array = field(default_factory=lambda: frozen(np.empty((0, 0))))
    branch: str = ''


@dataclass(frozen=True)
class SpherePlan:
    """The poses of one sphere, in the order of visit, and what it took to find them.

    `spares` take the place of poses at which the sphere turns out to be beyond the styli: the
    sphere is nearer to the probe's centre in them. `refused` counts by branch and reason.
    """

    location: int
    sphere: int
    poses: tuple[PlannedPose, ...]
    spares: tuple[PlannedPose, ...]
    orientations: int
    unreachable: int
    refused: Mapping[tuple[str, str], int] = field(default_factory=dict)

    @property
    def reasons(self) -> dict[str, int]:
        """How many branches were refused for which reason, the most frequent first."""
        counts: dict[str, int] = {}
        for (_, reason), count in self.refused.items():
            counts[reason] = counts.get(reason, 0) + count
        return dict(sorted(counts.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class Expected:
    """Standard uncertainty (m) of a position anywhere in the workspace, root mean square: as the
    arm is known `before`, and `after` a calibration with the program's poses."""

    before: float
    after: float


@dataclass(frozen=True)
class Program:
    """All spheres of all locations, in the order of visit."""

    spheres: tuple[SpherePlan, ...]
    expected: Expected | None = None
    poses: tuple[PlannedPose, ...] = field(init=False)

    def __post_init__(self) -> None:
        poses = tuple(pose for sphere in self.spheres for pose in sphere.poses)
        object.__setattr__(self, 'poses', poses)

    @property
    def unreached(self) -> tuple[tuple[int, int], ...]:
        """Location and sphere of those that no posture reaches."""
        return tuple((s.location, s.sphere) for s in self.spheres if not s.poses)


@dataclass(frozen=True)
class Draft:
    """A sphere on its way into the program: what there is to choose from."""

    location: int
    sphere: int
    candidates: Candidates
    spares: Candidates


class Planner:
    """Makes programs for one arm with one probe.

    Raises:
        InverseError: the arm has no inverse kinematics in closed form.
        ProgramError: the offsets asked for are beyond the styli's stroke.
        BodyError: the sizes given for the arm's links are not as many as it has.
    """

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge, settings: ProgramSettings) -> None:
        self.arm = arm
        self.probe = probe
        self.gauge = gauge
        self.settings = settings
        reach = Reach(
            settings.limit_margin, settings.singular_margin, settings.approach, settings.bodies
        )
        self._finder = Finder(arm, probe, gauge, reach)
        self.telling = Telling(arm, probe, gauge, settings.choice)
        self._T_probe_flange = np.linalg.inv(probe.flange_T_probe.matrix())
        self._seat = self._seat_of(probe)

    def _seat_of(self, probe: Probe) -> Array:
        """Where in the probe (3,) a sphere sits when the styli are halfway in."""
        if not isinstance(probe, ActiveProbe):
            return probe.center
        diameter = self.gauge.sphere_diameter
        middle = probe.stroke.mean(axis=1)
        seat: Array = probe.centers(middle[None], diameter)[0]
        even = even_sequence(200, 2, np.zeros(2))
        around = seat + self.settings.offset[1] * sphere_directions(even[:, 0], even[:, 1])
        if not probe.within_stroke(probe.displacements(around, diameter)).all():
            length = self.settings.offset[1] * 1e3
            raise ProgramError(f'{probe.name}: an offset of {length:g} mm is beyond its stroke')
        return seat

    def program(
        self, placements: Mapping[int, RigidTransform], locations: Sequence[int] = ()
    ) -> Program:
        """The program for `locations` (all when empty) of `placements` (`T_base_gauge`).

        Raises:
            ProgramError: a location is not among the placements, or none of its spheres can be
                reached; says which spheres and what kept the arm from them.
            DataError: the gauge has no such sphere.
        """
        unknown = [number for number in locations if number not in placements]
        if unknown:
            raise ProgramError(
                f'location {unknown[0]} has no place (there are {sorted(placements)})'
            )
        drafts: list[Draft] = []
        for location in locations or sorted(placements):
            found = [
                self.draft(placements[location], location, sphere)
                for sphere in self.settings.spheres
            ]
            _refuse_out_of_reach(self.arm, location, found)
            drafts += found
        pools = [self.pool(placements[draft.location], draft) for draft in drafts]
        chosen = choose(self.telling, pools, self.settings.poses_per_sphere).chosen
        return self._ordered(drafts, chosen, self._expected(pools, chosen))

    def draft(self, T_base_gauge: RigidTransform, location: int, sphere: int) -> Draft:
        """The candidates of one sphere."""
        settings = self.settings
        R_base_gauge = T_base_gauge.rotation
        p_base_sphere = T_base_gauge.apply(self.gauge.center(sphere))
        self._finder.put_gauge(T_base_gauge, sphere)
        key = (settings.seed, location, sphere)
        hands = self._hands(R_base_gauge, p_base_sphere, key)
        found = self._finder.find(hands, settings.pool * settings.poses_per_sphere)
        # where the gauge is not quite where it should be, offsets are what takes spheres too far
        hands = self._hands(R_base_gauge, p_base_sphere, (*key, 1), offset_share=0.2)
        planned = min(len(found.found), settings.poses_per_sphere)
        spare = self._finder.find(hands, math.ceil(SPARE_SHARE * planned))
        return Draft(location, sphere, found, spare)

    def pool(self, T_base_gauge: RigidTransform, draft: Draft) -> Pool:
        """What the candidates of one sphere tell."""
        found = draft.candidates.found
        center = T_base_gauge.apply(self.gauge.center(draft.sphere))
        joints = joints_of(found, self.arm.n)
        seats = np.array([each.p_probe_sphere for each in found]).reshape(-1, 3)
        return Pool(draft.location, draft.sphere, center, self.telling.rows(joints, seats))

    def _expected(self, pools: Sequence[Pool], chosen: Sequence[Indices]) -> Expected:
        telling = self.telling
        return Expected(
            telling.position_uncertainty(telling.known),
            telling.position_uncertainty(information_of(telling, pools, chosen)),
        )

    def _ordered(
        self, drafts: Sequence[Draft], chosen: Sequence[Indices], expected: Expected
    ) -> Program:
        """The chosen poses of one sphere after the other, each sphere's in a short order."""
        here = self._home()
        plans: list[SpherePlan] = []
        for draft, rows in zip(drafts, chosen, strict=True):
            picked = [draft.candidates.found[i] for i in rows]
            order = short_order(here, [each.postures for each in picked], self.arm.velocity)
            names = branch_names(self.arm, joints_of(picked, self.arm.n))
            poses = tuple(self._planned(draft, picked[i], which, names[i]) for i, which in order)
            here = poses[-1].joints if poses else here
            spares = tuple(self._planned(draft, each, 0) for each in draft.spares.found)
            candidates = draft.candidates
            plans.append(SpherePlan(
                draft.location, draft.sphere, poses, spares, candidates.tried,
                candidates.unreachable, candidates.refusals(self.arm),
            ))  # fmt: skip
        return Program(tuple(plans), expected)

    def _planned(
        self, draft: Draft, candidate: Candidate, which: int, branch: str = ''
    ) -> PlannedPose:
        joints = candidate.postures[which]
        way = candidate.way[::-1] if self.settings.drive_approach else candidate.way[:0]
        return PlannedPose(
            draft.location, draft.sphere, frozen(joints), frozen(candidate.p_probe_sphere),
            frozen(joints + way), branch,
        )  # fmt: skip

    def _home(self) -> Array:
        limits = np.clip(self.arm.limits, -np.pi, np.pi)
        middle: Array = limits.mean(axis=1)
        return middle

    def _hands(
        self, R_base_gauge: Array, p_base_sphere: Array, key: tuple[int, ...],
        offset_share: float = 1.0,
    ) -> Iterator[Hand]:  # fmt: skip
        """Hands evenly over the cap around a sphere; another `key`, other ones."""
        settings = self.settings
        start = np.random.default_rng(key).random(CHOICES)
        hands = TRIES_PER_POSE * settings.pool * settings.poses_per_sphere
        even = even_sequence(hands, CHOICES, start)
        outward = cap_directions(even[:, 0], even[:, 1], settings.cap) @ R_base_gauge.T
        shortest, longest = settings.offset if isinstance(self.probe, ActiveProbe) else (0.0, 0.0)
        length = offset_share * (shortest + (longest - shortest) * even[:, 5])
        offsets = length[:, None] * sphere_directions(even[:, 3], even[:, 4])
        redundant = self._finder.inverse.redundant_range()
        for row, direction, offset in zip(even, outward, offsets, strict=True):
            T_base_probe = np.eye(4)
            T_base_probe[:3, :3] = looking_along(-direction, 2 * np.pi * row[2])
            p_probe_sphere = self._seat + offset
            T_base_probe[:3, 3] = p_base_sphere - T_base_probe[:3, :3] @ p_probe_sphere
            swept = redundant[0] + row[6] * (redundant[1] - redundant[0])
            yield Hand(T_base_probe @ self._T_probe_flange, p_probe_sphere, float(swept))


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
