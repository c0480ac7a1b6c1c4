# SPDX-License-Identifier: Apache-2.0
"""The ways of a run: to the next pose, away from a sphere, out of the way of the gauge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calib_capture.measuring.run_settings import RunSettings
from calib_capture.motion import Leg
from calib_capture.program import PlannedPose, Program, visit
from calib_model.arrays import Array, largest_difference
from calib_model.instruments import Arm

Turns = Callable[[PlannedPose], Array]
NO_FREE_WAY = 'no free way'
TURNED = 2  # poses: at the first there may be no contact, or messages may be lost
STEP_ASIDE = 0.01  # rad of the last joint: enough for a new stop, little for the probe


class PoseWays:
    """Leads the arm as the program says, or by what is found anew where the arm is not where the
    program has it. Remembers at which poses the arm may be, to leave their spheres by the approach.
    At the first poses it turns each joint by `turns` (n,) of them and back, if any.
    """

    def __init__(
        self, arm: Arm, program: Program, settings: RunSettings, turns: Turns | None = None
    ) -> None:
        self._arm, self._settings, self._turns = arm, settings, turns
        self._limits, self._turned = settings.limits(arm), 0
        self._visited: list[PlannedPose] = []  # since where the last command began
        self.plan_anew(program)

    def plan_anew(self, program: Program) -> None:
        """From now on by this program."""
        self._way_to, self._touching = program.way_to, program.touching
        self._rest, self._way_out = program.rest, program.way_out

    def forget(self) -> None:
        """The arm may have been moved by others: it is on no approach."""
        self._visited = []

    def leg(self, start: Array) -> Leg:
        """A command that begins in a posture (n,), at rest."""
        return Leg(start, self._limits)

    def begin(self, start: Array, first: PlannedPose) -> Leg:
        """A command to poses, the `first` of them."""
        leg = self.leg(start)
        self._visited = self._visited[-1:]
        if not len(first.approach) and self._same(start, first.joints):
            leg.to(self._aside(start))  # without it there would be no new stop
        return leg

    def go_to(self, leg: Leg, pose: PlannedPose) -> bool:
        """To a pose by its approach and a rest there; False when no free way leads to it: then it
        has left the sphere where it was."""
        self.leave_sphere(leg)
        between = self._between(leg.here, pose)
        if between is None:
            return False
        visit(leg, pose, between, self._settings.approach_speed, self._settings.hold)
        if self._turns is not None and self._turned < TURNED:
            leg.turn(self._turns(pose))
            self._turned += 1
        self._visited.append(pose)
        return True

    def leave_sphere(self, leg: Leg) -> None:
        """Along the approach, where the arm is on one."""
        back, standoff = self._retreat(leg.here)
        leg.along(back, standoff / self._settings.approach_speed)

    def leave_location(self, leg: Leg, location: int, first: PlannedPose) -> None:
        """Out of the way of the gauge, as the way to the `first` pose of the next location leads
        or as is found; where none is, it has left the sphere at least."""
        self.leave_sphere(leg)
        for posture in self._to_rest(leg.here, location, first.way):
            leg.to(posture)

    def at_rest(self, here: Array) -> bool:
        """Whether a posture (n,) is the one in which the arm waits for the gauge."""
        return self._rest is not None and self._same(here, self._rest)

    def why_not(self, here: Array, pose: PlannedPose) -> str:
        """Why no way leads to a pose: the arm may stand where the gauge is to be."""
        touching = self._touching(here, pose) if self._touching is not None else ''
        return f'{NO_FREE_WAY}, {touching} where the arm stands' if touching else NO_FREE_WAY

    def _same(self, one: Array, other: Array) -> bool:
        return largest_difference(one, other) <= self._settings.tolerance

    def _to_rest(self, here: Array, location: int, way: Array) -> Array:
        """Postures (K, n) by which the arm gets out of the way."""
        if self._rest is None:
            return np.empty((0, self._arm.n))
        ends = np.flatnonzero([np.array_equal(posture, self._rest) for posture in way])
        if len(ends) and self._same(way[0], here):
            return way[1 : ends[0] + 1]
        if self._way_out is None:
            return self._rest[None]
        between = self._way_out(here, location)
        return np.empty((0, self._arm.n)) if between is None else np.vstack([between, self._rest])

    def _retreat(self, here: Array) -> tuple[Array, float]:
        """What to go by (K, n) away from a sphere, over how many m, where the arm is on its
        approach to one or has arrived."""
        for pose in reversed(self._visited):
            if not len(pose.approach):
                continue
            chain = np.vstack([pose.approach, pose.joints])
            for first in range(len(chain) - 2, -1, -1):
                if self._on(here, chain[first], chain[first + 1]):
                    return chain[first::-1], pose.standoff * (first + 1) / (len(chain) - 1)
        return np.empty((0, self._arm.n)), 0.0

    def _on(self, here: Array, one: Array, other: Array) -> bool:
        """Whether a posture is on the straight way between two."""
        way = other - one
        part = min(max(float((here - one) @ way / (way @ way)), 0.0), 1.0)
        return self._same(one + part * way, here)

    def _between(self, start: Array, pose: PlannedPose) -> Array | None:
        """What to go by from `start` to where a pose's approach begins: as the program says, or
        found anew where the arm is not where the program has it."""
        if self._way_to is None or not len(pose.approach):
            return pose.way[1:]
        for row, posture in enumerate(pose.way):  # it may have waited for the gauge on the way
            if self._same(posture, start):
                return pose.way[row + 1 :]
        return self._way_to(start, pose)

    def _aside(self, here: Array) -> Array:
        """A posture close by: an arm that never left makes no new stop."""
        aside = here.copy()
        aside[-1] += -STEP_ASIDE if here[-1] > self._arm.zero[-1] else STEP_ASIDE
        return aside
