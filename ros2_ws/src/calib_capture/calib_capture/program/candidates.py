# SPDX-License-Identifier: Apache-2.0
"""Postures in which a sphere can be probed, and why others cannot."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from calib_capture.motion import (
    BodySettings,
    CollisionCheck,
    FreePaths,
    InverseKinematics,
    PinocchioArm,
    bodies_of,
    retreat,
    singular_margin,
)
from calib_model.arrays import Array
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.kinematics import joint_frames
from calib_model.transforms import RigidTransform

NO_BRANCH = '-'  # where it was the hand that no branch reaches
OUT_OF_REACH = 'out of reach'
LIMITS = 'joint limits'
SINGULAR = 'near a singularity'
NO_WAY_BACK = 'no straight way back'
ON_THE_WAY = ' on the way'
MOST_BRANCHES, TOGETHER = 1000, 8
BETWEEN = 'something touches on the way'
NO_FREE_WAY = 'no free way to it'
HOPELESS = 100  # hands in vain after which a sphere counts as out of reach
POOR = 6  # hands for every candidate, more of which are not tried after these


@dataclass(frozen=True)
class Hand:
    """A flange pose (4, 4), where it has the sphere in the probe (3,), and a redundant joint."""

    T_base_flange: Array
    p_probe_sphere: Array
    redundant: float


@dataclass(frozen=True)
class Reach:
    """What keeps a posture from being planned, all lengths in m, angles in rad.

    `limit_margin` off the joint limits, `singular_margin` off singular postures, `approach` the
    way along the probe's axis that must be free; `bodies` None leaves collisions unchecked.
    """

    limit_margin: float
    singular_margin: float
    approach: float
    bodies: BodySettings | None


@dataclass(frozen=True)
class Candidate:
    """A branch of a hand: its postures (K, n), full turns apart, and the `way` (S, n) by which
    each of them is left, as differences from it."""

    postures: Array
    way: Array
    p_probe_sphere: Array

    @property
    def ends(self) -> Array:
        """Where it is left to (K, n)."""
        return self.postures + self.way[-1] if len(self.way) else self.postures


@dataclass
class Candidates:
    """What was found for one sphere. `refused`: postures (n,), None where the hand was out of
    reach, and why. `tried` hands, `unreachable` those of them without a branch within limits."""

    found: list[Candidate] = field(default_factory=list)
    refused: list[tuple[Array | None, str]] = field(default_factory=list)
    tried: int = 0
    unreachable: int = 0

    def reasons(self) -> Counter[str]:
        """How many branches were refused for which reason."""
        return Counter(reason for _, reason in self.refused)

    def refusals(self, arm: Arm) -> Counter[tuple[str, str]]:
        """How many branches were refused, by branch and reason."""
        reached = [(q, reason) for q, reason in self.refused if q is not None]
        names = branch_names(arm, np.array([q for q, _ in reached]).reshape(-1, arm.n))
        counts = Counter(zip(names, (reason for _, reason in reached), strict=True))
        if missed := len(self.refused) - len(reached):
            counts[NO_BRANCH, OUT_OF_REACH] = missed
        return counts


class Finder:
    """Finds the candidates of one arm with one probe before a gauge."""

    def __init__(self, arm: Arm, probe: Probe, gauge: Gauge, reach: Reach) -> None:
        self.arm = arm
        self.inverse = InverseKinematics(arm)
        self._reach = reach
        self._model = PinocchioArm(arm)
        self._size = float(np.abs(arm.geometry[[0, 2]]).sum())
        self._shoulder, self._stretched = stretched(arm)
        self._R_flange_probe = probe.flange_T_probe.rotation
        self._bodies = None
        if reach.bodies is not None:
            self._bodies = bodies_of(arm, probe, gauge, reach.bodies)
        self.stand(())

    def stand(self, places: Sequence[RigidTransform]) -> None:
        """Gauges stand at these `T_base_gauge` from now on, beside the one that is put in place."""
        self._collision: CollisionCheck | None = None
        if self._bodies is not None:
            self._collision = CollisionCheck(self.arm, self._bodies, places)
        self.ways = FreePaths(self.arm, self._collision, self._bodies, self._reach.limit_margin)

    def put_gauge(self, T_base_gauge: RigidTransform, sphere: int = -1) -> None:
        """Where the gauge stands from now on and which of its spheres is probed, if any."""
        if self._collision is not None:
            self._collision.put_gauge(T_base_gauge, sphere)

    def find(self, hands: Iterator[Hand], wanted: int) -> Candidates:
        """The branches of one hand after the other until there are `wanted`, or hardly any."""
        candidates = Candidates()
        while together := list(islice(hands, TOGETHER)):
            for hand, branches in zip(together, self._branches(together), strict=True):
                found = len(candidates.found)
                if found >= wanted or candidates.tried >= HOPELESS + POOR * found:
                    del candidates.found[wanted:]
                    return candidates
                self._take(hand, branches, candidates)
        del candidates.found[wanted:]
        return candidates

    def take(self, hands: Sequence[Hand], candidates: Candidates, most: int) -> int:
        """Judge the branches of some hands, of each until `most` are found good; how many hands
        have one."""
        reached = 0
        for hand, branches in zip(hands, self._branches(hands), strict=True):
            before = len(candidates.found)
            self._take(hand, branches, candidates, most)
            reached += len(candidates.found) > before
        return reached

    def _take(
        self, hand: Hand, branches: Array, candidates: Candidates, most: int = MOST_BRANCHES
    ) -> None:
        candidates.tried += 1
        wanted = len(candidates.found) + most
        if not len(branches):
            candidates.refused.append((None, OUT_OF_REACH))
        inside = 0
        back = -(hand.T_base_flange[:3, :3] @ self._R_flange_probe)[:, 2]
        for posture in branches:
            if len(candidates.found) == wanted:
                break
            turned = self._within_limits(self.inverse.within_limits(posture[None]))
            inside += len(turned) > 0
            way, reason = self._judge(turned, back)
            if reason:
                candidates.refused.append((posture, reason))
            else:
                kept = turned[self._ways_within_limits(turned, way)]
                candidates.found.append(Candidate(kept, way, hand.p_probe_sphere))
        candidates.unreachable += inside == 0

    def _branches(self, hands: Sequence[Hand]) -> list[Array]:
        poses = [hand.T_base_flange for hand in hands]
        near = [
            i
            for i, pose in enumerate(poses)
            if np.linalg.norm(pose[:3, 3] - self._shoulder) <= self._stretched
        ]
        found: list[Array] = [np.empty((0, self.arm.n))] * len(hands)
        if near:
            swept = [hands[i].redundant for i in near]
            for i, branches in zip(
                near, self.inverse.branches_of([poses[i] for i in near], swept), strict=True
            ):
                found[i] = branches
        return found

    def _judge(self, turned: Array, back: Array) -> tuple[Array, str]:
        """The way back (S, n) from the postures (K, n) of a branch, and what speaks against it."""
        none = np.empty((0, self.arm.n))
        if not len(turned):
            return none, LIMITS
        q = turned[0]
        if singular_margin(self._model, q, self._size) < self._reach.singular_margin:
            return none, SINGULAR
        if contact := self.contact(q):
            return none, contact
        if self._reach.approach == 0:
            return none, ''
        path = retreat(self._model, q, back, self._reach.approach)
        if path is None:
            return none, NO_WAY_BACK
        way = path - q
        if not self._ways_within_limits(turned, way).any():
            return way, LIMITS + ON_THE_WAY
        return way, self._met(np.vstack([q, path]))

    def _met(self, path: Array) -> str:
        """What touches on the way back (S + 1, n), and from its end on the probed sphere too."""
        contacts = (self.contact(posture) for posture in path[1:])
        met = next((contact for contact in contacts if contact), '') or self.contact(
            path[-1], seated=False
        )
        if met:
            return met + ON_THE_WAY
        pairs = zip(path, path[1:], strict=False)
        free = all(self.ways.free(here, there, seated=True) for here, there in pairs)
        return '' if free else BETWEEN

    def way_from(self, start: Array, goal: Array) -> Array | None:
        """Postures (K, n) to go by from `start` to `goal`; an arm that stands at a sphere leaves
        it along the probe's axis first, one that touches anything else by turning a joint. None
        when no free way is found."""
        if self.ways.clear(start):
            return self.ways.between(start, goal)
        back = -(self._model.flange_pose(start)[:3, :3] @ self._R_flange_probe)[:, 2]
        path = retreat(self._model, start, back, self._reach.approach)
        if path is None or not self.ways.clear(path[-1]):  # it does not stand at a sphere
            aside = self.ways.left(start)
            path = None if aside is None else aside[None]
        if path is None:
            return None
        between = self.ways.between(path[-1], goal)
        return None if between is None else np.vstack([path, between])

    def gap(self, q: Array) -> float:
        """How far (m) arm and probe are from gauge and floor in posture q (n,)."""
        return np.inf if self._collision is None else self._collision.gap_outside(q, False)

    def contact(self, q: Array, seated: bool = True) -> str:
        """What touches in posture q (n,); `seated`: but for styli and probed sphere."""
        return self._collision.contact(q, seated) if self._collision is not None else ''

    def _within_limits(self, q: Array) -> Array:
        return q[self.arm.within_limits(q, self._reach.limit_margin)]

    def _ways_within_limits(self, turned: Array, way: Array) -> np.ndarray:
        """Which of the postures (K, n) can go their way, shape (K,)."""
        inside = np.ones(len(turned), dtype=bool)
        for step in way:
            inside &= self.arm.within_limits(turned + step, self._reach.limit_margin)
        return inside


def stretched(arm: Arm) -> tuple[Array, float]:
    """Where on its first axis an arm begins (3,), and how far from there its flange is at most, m.

    No posture reaches as far: lengths are added as if they were all in line.
    """
    a, _, d, *_ = arm.geometry
    shoulder: Array = arm.base_T_dh.apply(np.array([0.0, 0.0, d[0]]))
    lengths = abs(a[0]) + np.hypot(a[1:], d[1:]).sum()
    return shoulder, float(lengths + np.linalg.norm(arm.dh_T_flange.translation))


def joints_of(candidates: Sequence[Candidate], n: int) -> Array:
    """One posture of each candidate, shape (N, n)."""
    return np.array([each.postures[0] for each in candidates]).reshape(-1, n)


def branch_names(arm: Arm, q: Array) -> list[str]:
    """The branch of postures q (N, n) as three signs: shoulder, elbow, wrist.

    Shoulder: on which side of the first axis the wrist is. Elbow: to which side it bends. Wrist:
    to which side its middle joint bends. Arms of one build have the same signs for the same look.
    """
    if not len(q):
        return []
    frames = list(joint_frames(arm, q))
    elbow, middle = arm.n - 4, arm.n - 2  # joints from 0
    z = [frame.z_joint for frame in frames]
    at_wrist = frames[middle].origin
    to_wrist = at_wrist - frames[0].origin_joint
    signs = np.stack(
        [
            np.einsum('ni,ni->n', np.cross(z[0], to_wrist), z[1]),
            np.einsum(
                'ni,ni->n',
                np.cross(
                    frames[elbow].origin_joint - frames[1].origin_joint,
                    at_wrist - frames[elbow].origin_joint,
                ),
                z[elbow],
            ),
            np.einsum('ni,ni->n', np.cross(z[middle - 1], z[middle + 1]), z[middle]),
        ],
        axis=1,
    )
    return [''.join('+' if sign >= 0 else '-' for sign in row) for row in signs]
