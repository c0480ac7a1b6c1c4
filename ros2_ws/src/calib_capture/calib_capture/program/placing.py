# SPDX-License-Identifier: Apache-2.0
"""Where to put the gauge: places in reach of an arm, and the set of them that tells most.

A place is drawn by a posture of the arm: the gauge's middle comes to where the probe is, its z axis
points to the probe, and it is turned about that anyhow. So most places that are drawn are in reach,
and they are spread as the arm's postures are. A few hands around each sphere then tell how much of
the place can be probed, and what the arm's parameters would gain.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, islice

import numpy as np

from calib_capture.motion import bodies_of
from calib_capture.program.candidates import (
    NO_FREE_WAY,
    OUT_OF_REACH,
    Candidate,
    Candidates,
    joints_of,
    stretched,
)
from calib_capture.program.orientations import looking_along
from calib_capture.program.planner import Planner
from calib_capture.program.pose_selection import log_det
from calib_capture.program.program import ProgramError
from calib_model.arrays import Array
from calib_model.kinematics import forward_kinematics
from calib_model.progress import Pace, Progress
from calib_model.transforms import RigidTransform, rotation_vector

BELOW_FLOOR, OUTSIDE, FROM_BELOW = 'below the floor', 'outside the region', 'probed from below'
DRAWN = 4000  # places at most, most of which are seen at once not to do
SPARE = 3  # usable places for each that is wanted
HANDS = 8  # around each sphere
BRANCHES = 2  # of each hand
FIRST, LEAST = 4, 2  # of the first so many hands, and of all, so many have to reach a sphere
NONE_IN, IN_VAIN, JUDGED = 1000, 60, 300  # places drawn, and judged, in vain; judged at most
NODES, CONNECTED = 16, 0.6  # postures between which ways are tried, and how many have to have one
DOWNWARDS = -0.2  # of the gauge's z axis: its stand is on the other side
EXCHANGES = 5
POSTURES = 100  # that are tried for one that touches nothing
FAR_AWAY = RigidTransform(np.array([0.0, 0.0, 1e4]))
DECIMALS = 3  # of m and rad: nobody sets up a bar more exactly


@dataclass(frozen=True)
class Place:
    """A place of the gauge, the share of hands around its spheres that can be reached, and what
    the poses that were looked at tell of the arm's parameters (F, F)."""

    T_base_gauge: RigidTransform
    reached: float
    information: Array


@dataclass(frozen=True)
class Placed:
    """The chosen places, the most telling first; `uncertainty` (m) is that of a position in the
    workspace after a calibration with the first, the first two, and so on. `drawn` places were
    looked at, `usable` of them can be probed; `refused` counts why others cannot."""

    places: tuple[Place, ...]
    uncertainty: tuple[float, ...]
    drawn: int
    usable: int
    refused: Counter[str] = field(default_factory=Counter)
    asked: int = 0

    @property
    def placements(self) -> dict[int, RigidTransform]:
        """`T_base_gauge` by location, counted from 1."""
        return {number: each.T_base_gauge for number, each in enumerate(self.places, start=1)}


class Placer:
    """Finds places for the gauge of a planner; `region` (3, 2) holds all its spheres, m."""

    def __init__(self, planner: Planner, region: Array | None = None) -> None:
        self._planner = planner
        self._region = region
        settings = planner.settings
        self._floor = settings.bodies.floor if settings.bodies is not None else None
        self._ends = self._solid()
        self._centers = np.array([planner.gauge.center(n) for n in planner.spheres])
        self._middle = self._centers.mean(axis=0)
        self._shoulder, length = stretched(planner.arm)
        seat = planner.probe.flange_T_probe.apply(planner.hands.seat)
        self._stretched = length + float(np.linalg.norm(seat))
        self._generator = np.random.default_rng(settings.seed)
        self.refused: Counter[str] = Counter()

    def _solid(self) -> tuple[Array, Array]:
        """Points of the gauge (K, 3) and how far it extends around them (K,), m."""
        planner = self._planner
        bodies = planner.settings.bodies
        if bodies is None:
            centers = np.array([center for _, center in planner.gauge.spheres])
            return centers, np.full(len(centers), planner.gauge.sphere_diameter / 2)
        gauge = bodies_of(planner.arm, planner.probe, planner.gauge, bodies).gauge
        points = [(end, body.radius) for body in gauge for end in (body.start, body.end)]
        return np.array([p for p, _ in points]), np.array([r for _, r in points])

    def place(self, count: int, progress: Progress | None = None) -> Placed:
        """`count` places, fewer where there are not so many.

        Raises:
            ProgramError: the gauge cannot be probed anywhere; says what is in the way.
        """
        self._refuse_too_long()
        found: list[Place] = []
        drawn, wanted = 0, SPARE * count
        pace = Pace(progress, 'looking for places', 'places')
        judged = 0
        while drawn < (DRAWN if found else NONE_IN) and len(found) < wanted and judged < JUDGED:
            if not found and judged == IN_VAIN:
                break
            T_base_gauge = self._drawn()
            drawn += 1
            why = self._unfit(T_base_gauge)
            if why:
                self.refused[why] += 1
                continue
            place, why = self._judged(T_base_gauge)
            judged += 1
            if place is None:
                self.refused[why] += 1
            else:
                found.append(place)
            pace(len(found), wanted)
        pace.end()
        if not found:
            raise ProgramError(self._nowhere(drawn))
        chosen, uncertainty = self._chosen(found, count)
        return Placed(tuple(chosen), uncertainty, drawn, len(found), self.refused, count)

    def _refuse_too_long(self) -> None:
        long, reach = self._length(), 2 * self._stretched
        if long > reach:
            raise ProgramError(
                f'{self._planner.gauge.name}: spheres {long:.3g} m apart, where '
                f'{self._planner.arm.name} reaches across {reach:.3g} m: choose others by --spheres'
            )

    def _length(self) -> float:
        return float(np.linalg.norm(np.ptp(self._centers, axis=0)))

    def _nowhere(self, drawn: int) -> str:
        arm, gauge = self._planner.arm, self._planner.gauge
        reasons = ', '.join(f'{why} {n}' for why, n in self.refused.most_common(3))
        long = self._length()
        return (
            f'{arm.name}: nowhere can the spheres {", ".join(map(str, self._planner.spheres))} of '
            f'{gauge.name}, {long:.3g} m long, all be probed; of {drawn} places: {reasons}'
        )

    def _drawn(self) -> RigidTransform:
        """A place for which there is a posture that has the gauge's middle in the probe."""
        planner = self._planner
        if self._region is not None:
            return self._drawn_in(self._region)
        q = self._posture()
        T_base_probe = forward_kinematics(planner.arm, q[None])[0]
        T_base_probe = T_base_probe @ planner.probe.flange_T_probe.matrix()
        seat = T_base_probe[:3, 3] + T_base_probe[:3, :3] @ planner.hands.seat
        return self._standing(seat, -T_base_probe[:3, 2])

    def _drawn_in(self, region: Array) -> RigidTransform:
        """A place whose middle is anywhere in the region, probed from anywhere but below."""
        middle = self._generator.uniform(region[:, 0], region[:, 1])
        height, azimuth = self._generator.uniform((DOWNWARDS, 0), (1, 2 * np.pi))
        level = np.sqrt(1 - height**2)
        outward = np.array([level * np.cos(azimuth), level * np.sin(azimuth), height])
        return self._standing(middle, outward)

    def _standing(self, middle: Array, outward: Array) -> RigidTransform:
        """The gauge with its middle (3,) there, its z axis along `outward` (3,), turned anyhow."""
        rotation = looking_along(outward, self._generator.uniform(0, 2 * np.pi))
        return RigidTransform(
            np.round(middle - rotation @ self._middle, DECIMALS),
            np.round(rotation_vector(rotation), DECIMALS),
        )

    def _posture(self) -> Array:
        """Joints (n,) anywhere in which the arm touches neither itself nor the floor."""
        lower, upper = self._planner.arm.ranges.T
        self._planner.finder.put_gauge(FAR_AWAY)
        for _ in range(POSTURES):
            q: Array = self._generator.uniform(lower, upper)
            if not self._planner.finder.contact(q):
                break
        return q

    def _unfit(self, T_base_gauge: RigidTransform) -> str:
        """Why the gauge cannot stand there, whatever the arm; empty when it can."""
        points, radii = self._ends
        there = T_base_gauge.apply(points)
        if T_base_gauge.rotation[2, 2] < DOWNWARDS:
            return FROM_BELOW
        if self._floor is not None and (there[:, 2] - radii < self._floor).any():
            return BELOW_FLOOR
        centers = T_base_gauge.apply(self._centers)
        if np.linalg.norm(centers - self._shoulder, axis=1).max() > self._stretched:
            return OUT_OF_REACH
        region = self._region
        outside = region is not None and ((there < region[:, 0]) | (there > region[:, 1])).any()
        return OUTSIDE if outside else ''

    def _judged(self, T_base_gauge: RigidTransform) -> tuple[Place | None, str]:
        """A place where every sphere can be probed, or why one cannot."""
        found: list[Candidates] = []
        reached = 0
        for sphere in self._planner.spheres:
            candidates, hands = self._around(T_base_gauge, sphere)
            if hands < LEAST:
                return None, _main_reason(candidates)
            found.append(candidates)
            reached += hands
        connected = self._connected(T_base_gauge, [c for each in found for c in each.found])
        if connected < CONNECTED:
            return None, NO_FREE_WAY
        share = reached / sum(each.tried for each in found)
        return Place(T_base_gauge, share, self._information(T_base_gauge, found)), ''

    def _connected(self, T_base_gauge: RigidTransform, found: Sequence[Candidate]) -> float:
        """The share of candidates in the largest group between which ways are free straight."""
        self._planner.finder.put_gauge(T_base_gauge)
        ends = np.array([each.ends[0] for each in found[:: max(len(found) // NODES, 1)]])
        group = np.arange(len(ends))
        near = np.abs(ends[:, None] - ends).max(axis=2)
        pairs = sorted(combinations(range(len(ends)), 2), key=lambda pair: near[pair])
        for one, other in pairs:
            if group[one] != group[other] and self._planner.finder.ways.free(
                ends[one], ends[other]
            ):
                group[group == group[other]] = group[one]
        return float(np.bincount(group).max() / len(ends))

    def _around(self, T_base_gauge: RigidTransform, sphere: int) -> tuple[Candidates, int]:
        """Candidates of a few hands around a sphere, and how many hands have any."""
        candidates = Candidates()
        key = (self._planner.settings.seed, sphere)
        hands = self._planner.hands.around(T_base_gauge, sphere, key)
        self._planner.finder.put_gauge(T_base_gauge, sphere)
        reached = self._planner.finder.take(list(islice(hands, FIRST)), candidates, BRANCHES)
        if reached:
            more = list(islice(hands, HANDS - FIRST))
            reached += self._planner.finder.take(more, candidates, BRANCHES)
        return candidates, reached

    def _information(self, T_base_gauge: RigidTransform, found: Sequence[Candidates]) -> Array:
        planner, information = self._planner, self._planner.information
        spheres = planner.spheres
        centers = np.array([T_base_gauge.apply(planner.gauge.center(n)) for n in spheres])
        rows = [
            information.rows(
                joints_of(each.found, planner.arm.n),
                np.array([candidate.p_probe_sphere for candidate in each.found]),
            )
            for each in found
        ]
        return information.about_parameters(information.of_location(spheres, centers, rows))

    def _chosen(self, found: Sequence[Place], count: int) -> tuple[list[Place], tuple[float, ...]]:
        """The places by which log det of the information grows most: one after the other, then
        exchanged while that gains."""
        information = self._planner.information
        chosen: list[int] = []
        while len(chosen) < min(count, len(found)):
            chosen.append(_best(found, chosen, information.known))
        for _ in range(EXCHANGES):
            before = list(chosen)
            for place in range(len(chosen)):
                rest = chosen[:place] + chosen[place + 1 :]
                chosen[place] = _best(found, rest, information.known)
            if chosen == before:
                break
        ordered: list[int] = []
        for _ in chosen:
            ordered.append(_best(found, ordered, information.known, among=chosen))
        total, sure = information.known, []
        for i in ordered:
            total = total + found[i].information
            sure.append(information.position_uncertainty(total))
        return [found[i] for i in ordered], tuple(sure)


def _best(
    found: Sequence[Place], chosen: Sequence[int], known: Array, among: Sequence[int] = ()
) -> int:
    total = known + sum(found[i].information for i in chosen)
    left = [i for i in among or range(len(found)) if i not in chosen]
    return max(left, key=lambda i: log_det(total + found[i].information))


def _main_reason(candidates: Candidates) -> str:
    reasons = candidates.reasons()
    return reasons.most_common(1)[0][0] if reasons else OUT_OF_REACH
