# SPDX-License-Identifier: Apache-2.0
"""FreePaths between postures on which arm, probe and gauge do not touch.

A straight way in joint space is halved until the gaps at both ends of each piece are together
wider than anything moves in between, so that nothing can meet there. How far anything moves is
bounded by what every joint turns, times what reaches farthest from its axis. Among the bodies of
the arm only the joints between two of them count: forearm and wrist are always near.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib_capture.motion.bodies import Bodies, Body
from calib_capture.motion.collision import CollisionCheck
from calib_capture.motion.rrt_connect import rrt_connect, shortened
from calib_model.arrays import Array
from calib_model.instruments import Arm

TURN, MOST_TURNS = 0.03, 20  # rad, and how often, that one joint turns out of where things touch
FINEST = 1e-3  # m that anything moves in a piece that is not halved, where no clearance is asked


#: how far apart things are in a posture (n,), m: of each pair, or the nearest alone
Gap = Callable[[Array], list[float]]


class FreePaths:
    """Free ways of one arm before the gauge of its collision check; None: everything is free.

    `limit_margin` (rad) keeps detours off the joint limits.
    """

    def __init__(
        self, arm: Arm, check: CollisionCheck | None, bodies: Bodies | None, limit_margin: float
    ) -> None:
        self._arm, self._check = arm, check
        limits = arm.ranges
        self._lower, self._upper = limits[:, 0] + limit_margin, limits[:, 1] - limit_margin
        self.reach = _reach(arm, bodies)
        pairs = check.self_pairs if check is not None else []
        self._nearing = np.array([_nearing(arm, *pair) for pair in pairs]).reshape(-1, arm.n)
        self._clearance = bodies.settings.clearance if bodies is not None else 0.0

    def clear(self, q: Array) -> bool:
        """Whether nothing touches in posture q (n,), the probed sphere included."""
        return self._check is None or not self._check.touches(q, seated=False)

    def free(self, start: Array, goal: Array, seated: bool = False) -> bool:
        """Whether nothing touches on the straight way between postures (n,), ends left out.

        `seated`: the styli may touch the probed sphere.
        """
        if self._check is None:
            return True
        check, turned = self._check, np.abs(self._arm.uncoupled(goal - start)[0])
        return self._piece_free(
            lambda q: [check.gap_outside(q, seated)], start, goal, self.reach[None] @ turned
        ) and self._piece_free(check.gaps_within, start, goal, self._nearing @ turned)

    def _piece_free(self, gap: Gap, start: Array, goal: Array, far: Array) -> bool:
        """Whether nothing of what `gap` measures meets, where it comes nearer by at most `far`."""

        def free(
            start: Array, goal: Array, before: list[float], after: list[float], far: list[float]
        ) -> bool:
            for nearer, one, other in zip(far, before, after, strict=True):
                if nearer > one + other and nearer > FINEST:
                    break
            else:
                return True
            middle = (start + goal) / 2
            between = gap(middle)
            half = [each / 2 for each in far]
            return (
                all(each >= self._clearance for each in between)
                and free(start, middle, before, between, half)
                and free(middle, goal, between, after, half)
            )

        return free(start, goal, gap(start), gap(goal), far.tolist())

    def retraced(self, trail: Array) -> Array:
        """Postures (K, n) from the last of a trail (N, n) that was free back to its first, both
        left out."""
        way = shortened(list(trail[::-1]), self.free)
        return np.array(way[1:-1]).reshape(-1, trail.shape[1])

    def left(self, q: Array) -> Array | None:
        """A posture (n,) in which nothing touches, by turning one joint of q (n,), the least that
        does; None when none does. What touches in q, or is too near, gets no nearer on the way."""
        if self._check is None or self.clear(q):
            return q
        turns = [sign * axis for axis in np.eye(len(q)) for sign in (1.0, -1.0)]
        gaps = [self._check.gap_outside(q, False)] * len(turns)
        for step in range(1, MOST_TURNS + 1):
            for turn in range(len(turns)):
                there = q + step * TURN * turns[turn]
                gap = self._check.gap_outside(there, False)
                inside = ((there >= self._lower) & (there <= self._upper)).all()
                apart = min(self._check.gaps_within(there), default=np.inf) >= self._clearance
                # once nearer or at a limit, a joint is tried no further
                gaps[turn] = gap if gap > gaps[turn] and inside and apart else np.inf
                if gaps[turn] < np.inf and self.clear(there):
                    return there
        return None

    def between(self, start: Array, goal: Array) -> Array | None:
        """Postures (K, n) to go by from one posture to another, none where the straight way is
        free; None when no free way was found. Same postures, same answer."""
        if self.free(start, goal):
            return np.empty((0, len(start)))
        if not (self.clear(start) and self.clear(goal)):
            return None
        generator = np.random.default_rng(0)
        return rrt_connect(
            start,
            goal,
            lambda a, b: self.clear(b) and self.free(a, b),
            lambda: generator.uniform(self._lower, self._upper),
            self.reach,
        )


def _reach(arm: Arm, bodies: Bodies | None) -> Array:
    """How far from each joint's axis (n,) anything can be that moves with it, m."""
    farthest = np.maximum(np.abs(arm.geometry[0]), 1e-3)
    for body in bodies.moving if bodies is not None else ():
        farthest = np.maximum(farthest, _body_reach(arm, body))
    return farthest


def _body_reach(arm: Arm, body: Body) -> Array:
    """How far from each joint's axis (n,) a body can be, m; 0 of joints that do not move it."""
    a, _, d, _, _ = arm.geometry
    links = np.hypot(a, d)
    carrier, ends = body.frame - 1, np.array([body.start, body.end])
    reach = np.zeros(arm.n)
    for joint in range(carrier):
        # to the origin of the joint before which the body is, and from there to its far end
        beyond = links[joint + 1 : carrier].sum() + np.linalg.norm(ends, axis=1).max()
        reach[joint] = abs(a[joint]) + beyond + body.radius
    if carrier >= 0:
        reach[carrier] = np.hypot(ends[:, 0], ends[:, 1]).max() + body.radius
    return reach


def _nearing(arm: Arm, one: Body, other: Body) -> Array:
    """By how much two bodies of an arm come nearer to one another at most when each joint (n,)
    turns, m/rad: those that move both leave them as they are."""
    still, moved = sorted((one, other), key=lambda body: body.frame)
    nearing = _body_reach(arm, moved)
    nearing[: still.frame] = 0.0
    return nearing
