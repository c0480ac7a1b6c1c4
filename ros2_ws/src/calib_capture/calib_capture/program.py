# SPDX-License-Identifier: Apache-2.0
"""The measuring program: in which postures the arm probes which sphere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calib_capture.inverse import InverseKinematics
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
    probe's centre: without it eq. 15 has no rank. `limit_margin` (rad) keeps off joint limits.
    """

    spheres: tuple[int, ...] = (1, 6, 10, 14)
    poses_per_sphere: int = 60
    cap: float = np.radians(70.0)
    offset: tuple[float, float] = (0.0010, 0.0015)
    limit_margin: float = np.radians(1.0)
    seed: int = 1


@dataclass(frozen=True)
class PlannedPose:
    """One posture (n,) in rad that brings the sphere to `p_probe_sphere` (3,), m."""

    location: int
    sphere: int
    joints: Array
    p_probe_sphere: Array


@dataclass(frozen=True)
class SpherePlan:
    """The poses of one sphere, in the order of visit, and what it took to find them.

    `spares` take the place of poses at which the sphere turns out to be beyond the styli: the
    sphere is nearer to the probe's centre in them.
    """

    location: int
    sphere: int
    poses: tuple[PlannedPose, ...]
    spares: tuple[PlannedPose, ...]
    orientations: int
    unreachable: int


@dataclass(frozen=True)
class Program:
    """All spheres of all locations, in the order of visit."""

    spheres: tuple[SpherePlan, ...]
    poses: tuple[PlannedPose, ...] = field(init=False)

    def __post_init__(self) -> None:
        poses = tuple(pose for sphere in self.spheres for pose in sphere.poses)
        object.__setattr__(self, 'poses', poses)

    @property
    def unreached(self) -> tuple[tuple[int, int], ...]:
        """Location and sphere of those that no posture reaches."""
        return tuple((s.location, s.sphere) for s in self.spheres if not s.poses)


@dataclass(frozen=True)
class Hand:
    """A flange pose (4, 4), where it has the sphere in the probe (3,), and a redundant joint."""

    T_base_flange: Array
    p_probe_sphere: Array
    redundant: float


@dataclass
class _Candidates:
    """Postures, each (K, n) with its full turns, and the seats that go with them."""

    postures: list[Array] = field(default_factory=list)
    seats: list[Array] = field(default_factory=list)
    tried: int = 0
    unreachable: int = 0


class Planner:
    """Makes programs for one arm with one probe.

    Raises:
        InverseError: the arm has no inverse kinematics in closed form.
        ProgramError: the offsets asked for are beyond the styli's stroke.
    """

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge, settings: ProgramSettings) -> None:
        self.arm = arm
        self.probe = probe
        self.gauge = gauge
        self.settings = settings
        self._inverse = InverseKinematics(arm)
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
            ProgramError: a location is not among the placements, or no sphere can be reached.
            DataError: the gauge has no such sphere.
        """
        unknown = [number for number in locations if number not in placements]
        if unknown:
            raise ProgramError(
                f'location {unknown[0]} has no place (there are {sorted(placements)})'
            )
        here = self._home()
        plans: list[SpherePlan] = []
        for location in locations or sorted(placements):
            for sphere in self.settings.spheres:
                plan = self.sphere_plan(placements[location], location, sphere, here)
                here = plan.poses[-1].joints if plan.poses else here
                plans.append(plan)
        program = Program(tuple(plans))
        if not program.poses:
            raise ProgramError(f'{self.arm.name}: none of the chosen spheres can be reached')
        return program

    def _home(self) -> Array:
        limits = np.clip(self.arm.limits, -np.pi, np.pi)
        middle: Array = limits.mean(axis=1)
        return middle

    def sphere_plan(
        self, T_base_gauge: RigidTransform, location: int, sphere: int, here: Array
    ) -> SpherePlan:
        """The poses of one sphere, visited from posture `here` (n,) on.

        Choosing the most telling poses of a larger pool and refusing those that collide have
        their place here, between the candidates and their order.
        """
        R_base_gauge = T_base_gauge.rotation
        p_base_sphere = T_base_gauge.apply(self.gauge.center(sphere))
        wanted = self.settings.poses_per_sphere
        key = (self.settings.seed, location, sphere)
        found = self._found(self._hands(R_base_gauge, p_base_sphere, key), wanted)
        # where the gauge is not quite where it should be, offsets are what takes spheres too far
        hands = self._hands(R_base_gauge, p_base_sphere, (*key, 1), offset_share=0.2)
        spare = self._found(hands, math.ceil(SPARE_SHARE * len(found.postures)))
        order = short_order(here, found.postures, self.arm.velocity)
        poses = (
            PlannedPose(location, sphere, frozen(found.postures[i][which]), frozen(found.seats[i]))
            for i, which in order
        )
        spares = (
            PlannedPose(location, sphere, frozen(postures[0]), frozen(seat))
            for postures, seat in zip(spare.postures, spare.seats, strict=True)
        )
        return SpherePlan(
            location, sphere, tuple(poses), tuple(spares), found.tried, found.unreachable
        )

    def _found(self, hands: Iterator[Hand], wanted: int) -> _Candidates:
        """The branches of one hand after the other until there are `wanted`."""
        found = _Candidates()
        for hand in hands:
            if len(found.postures) >= wanted:
                break
            branches = self._branches(hand.T_base_flange, hand.redundant)
            found.tried += 1
            found.unreachable += not branches
            branches = branches[: wanted - len(found.postures)]
            found.postures += branches
            found.seats += [hand.p_probe_sphere] * len(branches)
        return found

    def _hands(
        self, R_base_gauge: Array, p_base_sphere: Array, key: tuple[int, ...],
        offset_share: float = 1.0,
    ) -> Iterator[Hand]:  # fmt: skip
        """Hands evenly over the cap around a sphere; another `key`, other ones."""
        settings = self.settings
        start = np.random.default_rng(key).random(CHOICES)
        even = even_sequence(TRIES_PER_POSE * settings.poses_per_sphere, CHOICES, start)
        outward = cap_directions(even[:, 0], even[:, 1], settings.cap) @ R_base_gauge.T
        shortest, longest = settings.offset if isinstance(self.probe, ActiveProbe) else (0.0, 0.0)
        length = offset_share * (shortest + (longest - shortest) * even[:, 5])
        offsets = length[:, None] * sphere_directions(even[:, 3], even[:, 4])
        redundant = self._inverse.redundant_range()
        for row, direction, offset in zip(even, outward, offsets, strict=True):
            T_base_probe = np.eye(4)
            T_base_probe[:3, :3] = looking_along(-direction, 2 * np.pi * row[2])
            p_probe_sphere = self._seat + offset
            T_base_probe[:3, 3] = p_base_sphere - T_base_probe[:3, :3] @ p_probe_sphere
            swept = redundant[0] + row[6] * (redundant[1] - redundant[0])
            yield Hand(T_base_probe @ self._T_probe_flange, p_probe_sphere, float(swept))

    def _branches(self, T_base_flange: Array, redundant: float) -> list[Array]:
        """The branches within limits, each (K, n) with its full turns."""
        found = []
        for branch in self._inverse.branches(T_base_flange, redundant):
            turned = self._inverse.within_limits(branch[None])
            inside = turned[self.arm.within_limits(turned, self.settings.limit_margin)]
            if len(inside):
                found.append(inside)
        return found
