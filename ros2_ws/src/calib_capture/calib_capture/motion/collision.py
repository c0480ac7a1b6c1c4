# SPDX-License-Identifier: Apache-2.0
"""Whether arm, probe and gauge touch: Pinocchio places the bodies, coal finds the contacts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import coal
import numpy as np
import pinocchio

from calib_capture.motion.bodies import WORLD, Bodies, Body
from calib_capture.motion.pinocchio_arm import PinocchioArm
from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.transforms import RigidTransform

ANOTHER = 'another gauge'
POSTURES = 50  # in all of which bodies touch that nothing parts


class CollisionCheck:
    """The bodies of one arm, its probe and a gauge that can be put from place to place.

    Where others like it stand at the `standing` places (`T_base_gauge`), they are in the way too;
    put in one of these places, the gauge is the one that stands there.
    """

    def __init__(self, arm: Arm, bodies: Bodies, standing: Sequence[RigidTransform] = ()) -> None:
        self._arm = PinocchioArm(arm)
        self._bodies = bodies
        self._geometry = pinocchio.GeometryModel()
        self._moving = [self._add(body) for body in bodies.moving]
        self._gauge = [self._add(body) for body in bodies.gauge]
        self._kinds: list[tuple[Body, Body | None]] = []
        self._add_pairs()
        self._local = [_placement(body) for body in bodies.gauge]
        self._standing = [(place, self._add_standing(place)) for place in standing]
        self._data = pinocchio.GeometryData(self._geometry)
        for request in self._data.collisionRequests:
            request.security_margin = bodies.settings.clearance
        own = [row for row, (_, other) in enumerate(self._kinds) if _of_itself(other)]
        self._outside = self._only([row for row in range(len(self._kinds)) if row not in own])
        self._look_within(own)
        self._seats: list[int] = []  # pairs of a stylus and the probed sphere
        self._seated = False
        self._pass_over_held(arm)

    def _add(self, body: Body) -> int:
        length = float(np.linalg.norm(body.end - body.start))
        shape = coal.Capsule(body.radius, length) if length > 0 else coal.Sphere(body.radius)
        made = pinocchio.GeometryObject(body.name, body.frame, _placement(body), shape)
        index: int = self._geometry.addGeometryObject(made)
        return index

    def _add_pairs(self) -> None:
        moving, gauge = self._bodies.moving, self._bodies.gauge
        # most likely first: the search ends with the first contact
        for i in reversed(range(len(moving))):
            for j in reversed(range(len(gauge))):
                self._pair(self._moving[i], self._gauge[j], moving[i], gauge[j])
        for i, j in self._bodies.self_pairs:
            self._pair(self._moving[i], self._moving[j], moving[i], moving[j])
        height = self._bodies.settings.floor
        if height is not None:
            under = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, height]))
            plane = coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
            floor = self._geometry.addGeometryObject(
                pinocchio.GeometryObject('floor', WORLD, under, plane)
            )
            for i, body in enumerate(moving):
                if body.frame > 2 or body.kind == 'probe':  # the foot stands on it
                    self._pair(self._moving[i], floor, body, None)

    def _add_standing(self, T_base_gauge: RigidTransform) -> range:
        """A gauge that stays where it is; its pairs."""
        begin, place = len(self._kinds), pinocchio.SE3(T_base_gauge.matrix())
        for body, local in zip(self._bodies.gauge, self._local, strict=True):
            other = replace(body, name=f'{body.name} {begin}', kind=ANOTHER, sphere=-1)
            index = self._add(other)
            self._geometry.geometryObjects[index].placement = place * local
            for moving, one in zip(self._moving, self._bodies.moving, strict=True):
                self._pair(moving, index, one, other)
        return range(begin, len(self._kinds))

    def _pair(self, first: int, second: int, one: Body, other: Body | None) -> None:
        self._geometry.addCollisionPair(pinocchio.CollisionPair(first, second))
        self._kinds.append((one, other))

    def _only(self, pairs: list[int]) -> pinocchio.GeometryData:
        """Of which only some pairs are looked at."""
        data = pinocchio.GeometryData(self._geometry)
        for pair in range(len(self._kinds)):
            if pair not in pairs:
                data.deactivateCollisionPair(pair)
        return data

    def _pass_over_held(self, arm: Arm) -> None:
        """Look no more at bodies of the arm that touch whatever the joints do: they are what a
        short wrist is drawn as, and no posture would be free."""
        generator, clearance = np.random.default_rng(0), self._bodies.settings.clearance
        held = list(range(len(self._own)))
        lower, upper = arm.ranges.T
        for q in generator.uniform(lower, upper, (POSTURES, arm.n)):
            if not held:
                return
            gaps = self.gaps_within(q)
            held = [row for row in held if gaps[row] < clearance]
        for pair in (self._own[row] for row in held):
            self._data.deactivateCollisionPair(pair)
        self._look_within([pair for row, pair in enumerate(self._own) if row not in held])

    def _look_within(self, own: list[int]) -> None:
        """These are the pairs of arm and probe themselves."""
        self._own, self._within = own, self._only(own)
        results = self._within.distanceResults
        self._apart = [results[pair] for pair in own]  # each is written anew by every measurement

    def put_gauge(self, T_base_gauge: RigidTransform, probed: int) -> None:
        """Put the gauge in its place; the styli may touch sphere `probed` and no other."""
        place = pinocchio.SE3(T_base_gauge.matrix())
        for index, local in zip(self._gauge, self._local, strict=True):
            self._geometry.geometryObjects[index].placement = place * local
        self._seat(False)
        for standing, pairs in self._standing:
            self._heed(pairs, not np.array_equal(standing.matrix(), T_base_gauge.matrix()))
        self._seats = [
            pair
            for pair, (one, other) in enumerate(self._kinds)
            if one.stylus and other is not None and other.sphere == probed and probed >= 0
        ]

    def _seat(self, seated: bool) -> None:
        """Whether the styli may touch the probed sphere from now on."""
        if seated == self._seated:
            return
        self._seated = seated
        self._heed(self._seats, not seated)

    def _heed(self, pairs: Iterable[int], heeded: bool) -> None:
        """Whether these pairs are looked at from now on."""
        for data in (self._data, self._outside):
            for pair in pairs:
                if heeded:
                    data.activateCollisionPair(pair)
                else:
                    data.deactivateCollisionPair(pair)

    def touches(self, q: Array, seated: bool = True) -> bool:
        """Whether anything touches in posture q (n,); `seated`: but for styli and probed sphere."""
        self._seat(seated)
        touching: bool = pinocchio.computeCollisions(
            self._arm.model,
            self._arm.data,
            self._geometry,
            self._data,
            self._arm.configuration(q),
            True,
        )
        return touching

    @property
    def self_pairs(self) -> list[tuple[Body, Body]]:
        """What of arm and probe may not touch what of them, in the order of `gaps_within`."""
        kinds = (self._kinds[pair] for pair in self._own)
        return [(one, other) for one, other in kinds if other is not None]

    def gap_outside(self, q: Array, seated: bool = True) -> float:
        """How far, m, arm and probe are from gauge and floor, negative where they overlap;
        `seated`: but for styli and probed sphere."""
        self._seat(seated)
        nearest = self._measure(self._outside, q)
        return float(self._outside.distanceResults[nearest].min_distance)

    def gaps_within(self, q: Array) -> list[float]:
        """How far, m, the two of each of the `self_pairs` are apart."""
        self._measure(self._within, q)
        return [each.min_distance for each in self._apart]

    def _measure(self, data: pinocchio.GeometryData, q: Array) -> int:
        posture = self._arm.configuration(q)
        nearest: int = pinocchio.computeDistances(
            self._arm.model, self._arm.data, self._geometry, data, posture
        )
        return nearest

    def contact(self, q: Array, seated: bool = True) -> str:
        """What touches in posture q (n,), as `probe touches rod`; empty when nothing does."""
        if not self.touches(q, seated):
            return ''
        active = self._data.activeCollisionPairs
        for pair, (one, other) in enumerate(self._kinds):
            if active[pair] and self._data.collisionResults[pair].isCollision():
                met = 'floor' if other is None else other.kind
                return f'{one.kind} touches {met}' if met != one.kind else 'arm touches itself'
        return 'contact'


def _of_itself(other: Body | None) -> bool:
    """Whether it is the arm's or the probe's, not the floor or the gauge."""
    return other is not None and other.frame != WORLD


def _placement(body: Body) -> pinocchio.SE3:
    """The frame of a body whose axis is z, about its middle."""
    way = body.end - body.start
    length = float(np.linalg.norm(way))
    z = way / length if length > 0 else np.array([0.0, 0.0, 1.0])
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return pinocchio.SE3(np.stack([x, np.cross(z, x), z], axis=-1), (body.start + body.end) / 2)
