# SPDX-License-Identifier: Apache-2.0
"""How a hand leads an arm around a seated sphere: smooth ways through postures that fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from calib_model.arrays import Array
from calib_model.instruments import Arm
from selfcenter_probe.operator.seating import reach, seated

TRIED = 1500  # random postures per sphere: how much of the room of postures gets looked into
ENOUGH = 15  # of these must fit: with fewer the hand is at the edge of what can be reached
LIMIT_MARGIN = np.radians(2.0)
WAYPOINTS = 9
LEG = (0.4, 1.3)  # rad, the joint that turns most between two waypoints
SPACING = 0.05  # rad, between the points of a way that are looked at
JUMP = 5.0  # times the spacing: further apart the way leads past a singular posture
SHORTEST = 1.5  # rad, of all joints together: less is not worth seating the probe for


@dataclass(frozen=True)
class Hold:
    """What holds a probe on one sphere: the true arm, and where a hand may come from.

    `p_flange` (3,) is to stay on `p_base` (3,), m; `axis` (3,) is the unit vector in the flange's
    frame along which the hand pushes, `side` (3,) the one in the base frame around which it may
    stand, up to `cap` (rad).
    """

    arm: Arm
    p_flange: Array
    p_base: Array
    axis: Array
    side: Array
    cap: float

    def fits(self, q: Array) -> NDArray[np.bool_]:
        """Which postures (N, n) keep the joint limits and hold the hand on its side."""
        rotation = reach(self.arm, q, self.p_flange).rotation
        towards = -(rotation @ self.axis) @ self.side
        inside: NDArray[np.bool_] = towards > np.cos(self.cap)
        return inside & self.arm.within_limits(q, LIMIT_MARGIN)


def postures(hold: Hold, generator: np.random.Generator) -> Array:
    """Postures (K, n), rad, from all over the joints' ranges; none where the sphere is too far."""
    limits = hold.arm.limits
    lower, upper = np.where(np.isfinite(limits), limits, [-np.pi, np.pi]).T
    start = generator.uniform(lower, upper, (TRIED, hold.arm.n))
    q, there = seated(hold.arm, start, hold.p_flange, hold.p_base)
    q = q[there]
    q = q[hold.fits(q)]
    return q if len(q) >= ENOUGH else q[:0]


def ways(hold: Hold, found: Array, count: int, generator: np.random.Generator) -> list[CubicSpline]:
    """Up to `count` ways through postures `found` (K, n), far from one another.

    Each takes the length of the way (rad, of all joints together, from 0 to its last knot) to
    joints (n,) that, once `seated`, hold the sphere within limits all along.
    """
    kept: list[CubicSpline] = []
    for start in _apart(found, 3 * count):
        way = _cut(hold, _through(found, _chain(found, start, generator)))
        if way is not None:
            kept.append(way)
        if len(kept) == count:
            break
    return kept


def _apart(found: Array, count: int) -> list[int]:
    """Rows of `found` (K, n), each as far as can be from those before: every branch gets one."""
    chosen = [0]
    distance = np.full(len(found), np.inf)
    for _ in range(min(count, len(found)) - 1):
        distance = np.minimum(distance, np.abs(found - found[chosen[-1]]).max(axis=1))
        chosen.append(int(np.argmax(distance)))
    return chosen


def _chain(found: Array, start: int, generator: np.random.Generator) -> list[int]:
    """Rows of postures to pass one after the other, none twice, each within a leg of the last."""
    chain = [start]
    while len(chain) < WAYPOINTS:
        leg = np.abs(found - found[chain[-1]]).max(axis=1)
        near = np.flatnonzero((leg > LEG[0]) & (leg < LEG[1]))
        near = near[~np.isin(near, chain)]
        if not len(near):
            break
        chain.append(int(generator.choice(near)))
    return chain


def _through(found: Array, chain: list[int]) -> CubicSpline | None:
    if len(chain) < 2:
        return None
    knots = found[chain]
    lengths = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    return CubicSpline(np.concatenate([[0.0], np.cumsum(lengths)]), knots)


def _cut(hold: Hold, way: CubicSpline | None) -> CubicSpline | None:
    """The longest part of a way that can be walked without lifting off, None if too short."""
    if way is None:
        return None
    along = np.linspace(0.0, way.x[-1], int(way.x[-1] / SPACING) + 2)
    q, there = seated(hold.arm, way(along), hold.p_flange, hold.p_base)
    good = there & hold.fits(q)
    joined = np.linalg.norm(np.diff(q, axis=0), axis=1) < JUMP * SPACING
    first, last = _longest(good, joined)
    if along[last] - along[first] < SHORTEST:
        return None
    return CubicSpline(along[first : last + 1] - along[first], q[first : last + 1])


def _longest(good: NDArray[np.bool_], joined: NDArray[np.bool_]) -> tuple[int, int]:
    """First and last of the longest run of good points, each joined to the next."""
    best, first = (0, 0), 0
    for i in range(1, len(good)):
        if not (good[i - 1] and good[i] and joined[i - 1]):
            first = i
        elif i - first > best[1] - best[0]:
            best = (first, i)
    return best
