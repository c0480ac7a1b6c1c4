# SPDX-License-Identifier: Apache-2.0
"""The poses of a run: still to be tried, commanded and open, taken, refused."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from calib_capture.measuring.locations import Locations
from calib_capture.measuring.tally import Tally
from calib_capture.program import PlannedPose, Program
from calib_model.arrays import Array, largest_difference
from calib_model.pairing import Reason, Refusal, SteadyPose

NO_ANSWER = 'no answer'
#: what the sphere's place decides comes out the same when tried again, the rest may not
WORTH_ANOTHER_TRY = (
    Reason.NO_READINGS,
    Reason.JOINTS_MISSING,
    Reason.ARM_UNSTEADY,
    Reason.STYLI_UNSTEADY,
)


@dataclass(frozen=True)
class TakenPose:
    """An accepted pose: what was planned and what was measured."""

    planned: PlannedPose
    measured: SteadyPose


class Attempt(NamedTuple):
    """A pose that is tried for the `number`th time."""

    pose: PlannedPose
    number: int = 1


class PoseQueue:
    """Each pose is to do until it is commanded, then open until there is an outcome: taken, tried
    again, or refused and replaced by a spare of its sphere as long as there are any.

    `taken` and `refused` are in the order in which it happened; `tally` and `locations` count.
    """

    def __init__(self, program: Program, attempts: int) -> None:
        self.tally = Tally(len(program.poses))
        self.locations = Locations(program.poses)
        self.taken: list[TakenPose] = []
        self.refused: list[PlannedPose] = []
        self._attempts = attempts
        self._open: list[Attempt] = []
        self._plan(program)

    def _plan(self, program: Program) -> None:
        self._todo = deque(Attempt(pose) for pose in program.poses)
        self._spares = {(plan.location, plan.sphere): list(plan.spares) for plan in program.spheres}

    def plan_anew(self, program: Program) -> None:
        """Go on by this program in place of what is to do by the one before."""
        self.tally.planned += len(program.poses) - len(self._todo)
        self.locations.plan_anew(program.poses)
        self._plan(program)

    @property
    def todo(self) -> Sequence[PlannedPose]:
        """The poses that are to be commanded, in order."""
        return [pose for pose, _ in self._todo]

    @property
    def next(self) -> PlannedPose | None:
        """The first of them."""
        return self._todo[0].pose if self._todo else None

    @property
    def open(self) -> Sequence[PlannedPose]:
        """The poses that were commanded and wait for an outcome, in order."""
        return [pose for pose, _ in self._open]

    @property
    def waiting(self) -> int:
        """How many these are."""
        return len(self._open)

    @property
    def current(self) -> PlannedPose | None:
        """The first of them."""
        return self._open[0].pose if self._open else None

    @property
    def done(self) -> bool:
        """Whether every pose has an outcome."""
        return not (self._todo or self._open)

    @property
    def left_at(self) -> Counter[tuple[int, int]]:
        """Poses without an outcome, by location and sphere."""
        return Counter((pose.location, pose.sphere) for pose in (*self.todo, *self.open))

    def command_next(self) -> None:
        """The next pose is commanded: from now on it is open."""
        self._open.append(self._todo.popleft())

    def refuse_next(self, reason: str) -> None:
        """The next pose cannot be commanded."""
        self._refuse(self._todo.popleft().pose, reason)

    def stopped_at(self, joints: Array, within: float) -> Attempt | None:
        """The open pose at which the arm has stopped, `within` so many rad of `joints` (n,); those
        before it had no answer, the arm has passed them by. None where nobody planned a stop."""
        near = (
            place
            for place, (pose, _) in enumerate(self._open)
            if largest_difference(pose.joints, joints) <= within
        )
        place = next(near, None)
        if place is None:
            return None
        passed, here, self._open = self._open[:place], self._open[place], self._open[place + 1 :]
        for each in passed:
            self._again(each, NO_ANSWER)
        return here

    def accept(self, attempt: Attempt, measured: SteadyPose) -> TakenPose:
        """A pose was measured."""
        self.tally.taken += 1
        self.locations.take(attempt.pose.location)
        self.taken.append(TakenPose(attempt.pose, measured))
        return self.taken[-1]

    def refuse(self, attempt: Attempt, refusal: Refusal) -> None:
        """A pose gave no measurement: it is tried again where that may help."""
        if refusal.reason in WORTH_ANOTHER_TRY:
            self._again(attempt, refusal.reason.value)
        else:
            self._refuse(attempt.pose, refusal.reason.value)

    def give_up_open(self) -> None:
        """The open poses get no answer any more; each is tried once more, then refused."""
        for attempt in reversed(self._open):
            self._again(attempt, NO_ANSWER)
        self._open = []

    def take_back_open(self) -> None:
        """The open poses are to do again, as if they had not been commanded."""
        self._todo.extendleft(reversed(self._open))
        self._open = []

    def excuse_open(self) -> None:
        """What becomes of the open poses is not theirs to answer for: this attempt counts not."""
        self._open = [Attempt(pose, 0) for pose in self.open]

    def _again(self, attempt: Attempt, reason: str) -> None:
        if attempt.number < self._attempts:
            self._todo.appendleft(Attempt(attempt.pose, attempt.number + 1))
            self.tally.tried_again[reason] += 1
        else:
            self._refuse(attempt.pose, reason)

    def _refuse(self, pose: PlannedPose, reason: str) -> None:
        """Count a pose as refused; another one of its sphere is tried in its place."""
        self.refused.append(pose)
        spares = self._spares[pose.location, pose.sphere]
        replaced = bool(spares) and reason != NO_ANSWER
        if replaced:
            self._todo.appendleft(Attempt(spares.pop(0)))
        self.tally.refuse(pose.location, pose.sphere, reason, replaced)
        self.locations.refuse(pose.location, reason, replaced)
