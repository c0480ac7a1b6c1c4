# SPDX-License-Identifier: Apache-2.0
"""FreePaths between postures on which arm, probe and gauge do not touch.

A straight way in joint space is halved until the gaps at both ends of each piece are together
wider than anything moves in between, so that nothing can meet there. How far anything moves is
bounded by what every joint turns, times what reaches farthest from its axis.
"""

from __future__ import annotations

import numpy as np

from calib_capture.motion.bodies import Bodies
from calib_capture.motion.collision import CollisionCheck
from calib_capture.motion.rrt_connect import rrt_connect
from calib_model.arrays import Array
from calib_model.instruments import Arm

FINEST = 1e-3  # m that anything moves in a piece that is not halved, where no clearance is asked


class FreePaths:
    """Free ways of one arm before the gauge of its collision check; None: everything is free.

    `limit_margin` (rad) keeps detours off the joint limits.
    """

    def __init__(
        self, arm: Arm, check: CollisionCheck | None, bodies: Bodies | None, limit_margin: float
    ) -> None:
        self._check = check
        limits = np.clip(arm.limits, -np.pi, np.pi)
        self._lower, self._upper = limits[:, 0] + limit_margin, limits[:, 1] - limit_margin
        self.reach = _reach(arm, bodies)
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
        gaps = self._gap(start, seated), self._gap(goal, seated)
        far = float(self.reach @ np.abs(goal - start))
        return self._piece_free(start, goal, gaps, far, seated)

    def _piece_free(
        self, start: Array, goal: Array, gaps: tuple[float, float], far: float, seated: bool
    ) -> bool:
        """A piece between gaps (m) in which nothing moves farther than `far` (m)."""
        if far <= max(gaps[0] + gaps[1], FINEST):
            return True
        middle = (start + goal) / 2
        gap = self._gap(middle, seated)
        return (
            gap >= self._clearance
            and self._piece_free(start, middle, (gaps[0], gap), far / 2, seated)
            and self._piece_free(middle, goal, (gap, gaps[1]), far / 2, seated)
        )

    def _gap(self, q: Array, seated: bool) -> float:
        return self._check.gap(q, seated) if self._check is not None else np.inf

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
    a, _, d, _, _ = arm.geometry
    links = np.hypot(a, d)
    reach = np.maximum(np.abs(a), 1e-3)
    for joint in range(arm.n):
        # to the origin of the joint before which the body is, and from there to its far end
        for body in bodies.moving if bodies is not None else ():
            carrier = body.frame - 1
            if carrier < joint:
                continue
            ends = np.array([body.start, body.end])
            if carrier == joint:
                far = np.hypot(ends[:, 0], ends[:, 1]).max()
            else:
                far = abs(a[joint]) + links[joint + 1 : carrier].sum()
                far += np.linalg.norm(ends, axis=1).max()
            reach[joint] = max(reach[joint], far + body.radius)
    return reach
