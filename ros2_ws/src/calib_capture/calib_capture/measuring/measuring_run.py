# SPDX-License-Identifier: Apache-2.0
"""A measuring run: what to command next, what came of it, when it is over. Knows no graph."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field, replace

import numpy as np

from calib_capture.measuring.commanded_motion import LEAD, CommandedMotion, StandingMean
from calib_capture.measuring.locations import Locations, OneGauge
from calib_capture.motion import (
    ACCELERATION,
    JERK,
    Leg,
    MotionLimits,
    Trajectory,
    motion_limits,
)
from calib_capture.program import PlannedPose, Program, motion_seconds, visit
from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm
from calib_model.pairing import Outcome, Reason, Refusal, SteadyPose, reasons_in_words

NO_ANSWER = 'no answer'
NO_FREE_WAY = 'no free way'
#: what the sphere's place decides comes out the same when tried again, the rest may not
WORTH_ANOTHER_TRY = (
    Reason.NO_READINGS,
    Reason.JOINTS_MISSING,
    Reason.ARM_UNSTEADY,
    Reason.STYLI_UNSTEADY,
)
STILL = 5e-4  # rad: more than encoders scatter
STANDS = 0.1  # s before an arm counts as standing that nobody commanded there
RESERVE = 0.85  # of acceleration and jerk is planned with: a stop may need the rest
STAMP_STEP = 1e-6  # s: stamps are rounded
STEP_ASIDE = 0.01  # rad of the last joint: enough for a new stop, little for the probe


class RunError(CalibrationError):
    """A measuring run that cannot go on."""


class SourceError(RunError):
    """A run that cannot go on because of who publishes, however well."""


@dataclass(frozen=True)
class RunSettings:
    """How poses are commanded: `batch` at a time, each held for `hold` s.

    `speed` is the share of the joints' largest speeds at which the arm goes from pose to pose,
    `approach_speed` (m/s) how fast it comes to a sphere and leaves it along the probe's axis;
    `acceleration` (rad/s^2) and `jerk` (rad/s^3) are the limits of joints whose description has
    none.

    `answer_timeout` (s of the wall clock) after the last sign of life the poses of a batch that
    have no outcome get none; `give_up` (s) without any accepted or refused pose ends the run.
    `tolerance` (rad) is how near to the planned joints a stop must be to be that pose's.
    Where the gauge is `carried` from location to location, the arm waits for it out of its way.
    """

    batch: int = 7
    hold: float = 0.06
    speed: float = 0.3
    approach_speed: float = 0.1
    acceleration: float = ACCELERATION
    jerk: float = JERK
    answer_timeout: float = 3.0
    give_up: float = 30.0
    tolerance: float = 2e-3
    attempts: int = 2
    carried: bool = False

    def limits(self, arm: Arm) -> MotionLimits:
        """What motion is planned with."""
        whole = motion_limits(arm, self.acceleration, self.jerk)
        return whole.share(self.speed, RESERVE, RESERVE)

    def timed(self, program: Program, arm: Arm) -> Program:
        """The program with how long it takes when it is commanded so."""
        moving = motion_seconds(
            program, self.limits(arm), self.approach_speed, self.hold, self.batch
        )
        commands = -(-len(program.poses) // self.batch)
        return replace(program, seconds=moving + LEAD * commands)


@dataclass(frozen=True)
class TakenPose:
    """An accepted pose: what was planned and what was measured."""

    planned: PlannedPose
    measured: SteadyPose


@dataclass
class Tally:
    """How the run is going."""

    planned: int
    taken: int = 0
    replaced: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    #: the same by location, sphere and reason
    refused_at: Counter[tuple[int, int, str]] = field(default_factory=Counter)

    @property
    def left(self) -> int:
        """Of the planned poses, those that are still to be tried."""
        return max(self.planned - self.done, 0)

    @property
    def done(self) -> int:
        """Of the planned poses, those that need no more attention."""
        return self.taken + sum(self.refused.values()) - self.replaced

    def line(self) -> str:
        """Counts in words."""
        why = (
            f' ({reasons_in_words(self.refused)}; {self.replaced} replaced)' if self.refused else ''
        )
        return f'{self.taken} poses taken, {sum(self.refused.values())} refused{why}'

    def so_far(self) -> str:
        """The same in a few words, while there is more to come."""
        why = f' ({reasons_in_words(self.refused)})' if self.refused else ''
        refused = sum(self.refused.values())
        return f'{self.taken} taken, {refused} refused{why}, {self.left} to go'


class MeasuringRun:
    """Commands the poses of a program batch by batch and matches the outcomes to them.

    The next batch goes out when the arm has held the last pose of the one before, so that a
    trajectory never replaces one that is still needed; at most two batches wait for outcomes, so
    that no more readings are on their way than a subscriber keeps.

    One gauge that is carried stands `at` a location to begin with, at the program's first where
    none is given. All of a location is done, its spares too, then the arm goes out of the way, and
    `awaits` says where the gauge is to be carried, until it was `carried`.
    """

    def __init__(
        self,
        arm: Arm,
        program: Program,
        settings: RunSettings,
        now: float,
        at: int | None = None,
    ) -> None:
        self.settings = settings
        self.tally = Tally(len(program.poses))
        self._expected = program.seconds
        self._way_to, self._touching = program.way_to, program.touching
        self._spares = {(plan.location, plan.sphere): list(plan.spares) for plan in program.spheres}
        self._arm = arm
        self._todo = deque[tuple[PlannedPose, int]]((pose, 1) for pose in program.poses)
        self._open: list[tuple[PlannedPose, int]] = []
        self._limits = settings.limits(arm)
        self.motion = CommandedMotion(motion_limits(arm, settings.acceleration, settings.jerk))
        self._here: Array | None = None
        self._stands = StandingMean(STILL)
        self._goal: Array | None = None
        self._left = True  # whether it has moved since it was told to
        self._heard = True  # whether it has been heard of since then
        self.paused = False
        self._visited: list[PlannedPose] = []  # those of the last command
        self.taken: list[TakenPose] = []
        self.refused: list[PlannedPose] = []
        self._sign_of_life = self._progress = self._start = now
        self._poseless = False  # whether it was last commanded to where no pose is
        self.locations = Locations(program.poses)
        self._rest, self._way_out = program.rest, program.way_out
        self._gauge: OneGauge | None = None
        if settings.carried and program.poses:
            first = program.poses[0].location
            self._gauge = OneGauge(at or first)
            if self._gauge.at != first:  # nothing moves before it is there
                self._gauge.wait(first, now, clear=False)

    @property
    def awaits(self) -> int | None:
        """The location where the gauge is to be carried now."""
        return None if self._gauge is None else self._gauge.to

    @property
    def out_of_the_way(self) -> bool:
        """Whether the arm that awaits the gauge stands where it was planned to wait."""
        return self._gauge is not None and self._gauge.clear

    @property
    def to_come(self) -> tuple[int, ...]:
        """The locations of the poses that are left, in order."""
        return tuple(dict.fromkeys(pose.location for pose, _ in self._todo))

    def carried(self, now: float) -> None:
        """The gauge stands where it was awaited; the arm may have been moved meanwhile."""
        assert self._gauge is not None
        self._start += self._gauge.carried(now)
        self._visited = []
        self._take_back()
        self._sign_of_life = self._progress = now

    def plan_anew(self, program: Program) -> None:
        """Go on by this program in place of what is left of the one before; while the gauge is
        awaited."""
        self.tally.planned += len(program.poses) - len(self._todo)
        self._todo = deque((pose, 1) for pose in program.poses)
        self._spares = {(plan.location, plan.sphere): list(plan.spares) for plan in program.spheres}
        self.locations.plan_anew(program.poses)
        self._way_to, self._touching = program.way_to, program.touching
        self._rest, self._way_out = program.rest, program.way_out

    @property
    def finished(self) -> bool:
        """Whether every pose has been taken or given up, and the arm is where it was sent."""
        return not (self._todo or self._open or self._poseless)

    @property
    def left_at(self) -> Counter[tuple[int, int]]:
        """Poses that are still to be tried, by location and sphere."""
        waiting = (*self._todo, *self._open)
        return Counter((pose.location, pose.sphere) for pose, _ in waiting)

    @property
    def current(self) -> PlannedPose | None:
        """The pose that is being waited for."""
        return self._open[0][0] if self._open else None

    def next_trajectory(self, now: float) -> Trajectory | None:
        """The next batch as a trajectory, None while the arm is busy with the last one."""
        if self.paused or self.awaits is not None or not self._free():
            return None
        self._poseless = False
        if not self._todo:
            return None
        if self._here_no_more(self._todo[0][0]):
            return self._out_of_the_way(now)
        leg = Leg(self._standing(), self._limits)
        self._step_aside(leg)
        self._visited = self._visited[-1:]
        left = self.settings.batch
        while self._todo and left and not self._here_no_more(self._todo[0][0]):
            pose, attempt = self._todo.popleft()
            if not self._go_to(leg, pose):
                self._refuse(pose, self._no_way(leg.here, pose))
                continue
            self._open.append((pose, attempt))
            self._visited.append(pose)
            left -= 1
        return self._commanded(leg, now, poseless=left == self.settings.batch)

    def _commanded(self, leg: Leg, now: float, poseless: bool) -> Trajectory | None:
        if not leg.moves:
            return None
        self._goal, self._poseless = leg.here, poseless
        self._left = self._heard = False
        self._sign_of_life = now
        return leg.trajectory()

    def _here_no_more(self, pose: PlannedPose) -> bool:
        """Whether the gauge is to be carried before a pose."""
        return self._gauge is not None and pose.location != self._gauge.at

    def _out_of_the_way(self, now: float) -> Trajectory | None:
        """To where the gauge can be carried, once all poses of where it stands have an outcome;
        None when the arm is there, or there is no free way: then it has left the sphere at least.
        """
        gauge = self._gauge
        assert gauge is not None
        if self._open:
            return None
        if not gauge.leaving:
            leg = Leg(self._standing(), self._limits)
            self._leave_sphere(leg)
            for posture in self._to_rest(leg.here):
                leg.to(posture)
            far = np.abs(leg.here - self._standing()).max() > self.settings.tolerance
            if far and (trajectory := self._commanded(leg, now, poseless=True)) is not None:
                gauge.leaving = True
                return trajectory
        gauge.wait(self._todo[0][0].location, now, self._at_rest())
        return None

    def _at_rest(self) -> bool:
        if self._rest is None:
            return False
        return bool(np.abs(self._standing() - self._rest).max() <= self.settings.tolerance)

    def _to_rest(self, here: Array) -> Array:
        """Postures (K, n) by which the arm gets out of the way: as the program leads to the next
        location, else as is found."""
        if self._rest is None or self._gauge is None:
            return np.empty((0, self._arm.n))
        way = self._todo[0][0].way
        ends = np.flatnonzero([np.array_equal(posture, self._rest) for posture in way])
        if len(ends) and np.abs(way[0] - here).max() <= self.settings.tolerance:
            return way[1 : ends[0] + 1]
        if self._way_out is None:
            return self._rest[None]
        between = self._way_out(here, self._gauge.at)
        return np.empty((0, self._arm.n)) if between is None else np.vstack([between, self._rest])

    def sent(self, trajectory: Trajectory, now: float) -> Trajectory:
        """The next batch as it is sent `now`: planning it took its time."""
        self._sign_of_life = now
        return self.motion.begin(trajectory, now)

    def _standing(self) -> Array:
        """Where the arm is commanded to be, or stands where nobody commanded it."""
        here = self._stands.mean
        assert here is not None
        if self._goal is not None and np.abs(here - self._goal).max() <= self.settings.tolerance:
            return self._goal
        return here

    def _free(self) -> bool:
        if self._here is None:
            return False
        if self._goal is None:  # it may still be coming to rest
            return self.motion.stopped and self._stands.held >= STANDS
        if not self._open and not self._poseless:
            return True
        there = np.abs(self._here - self._goal).max() <= self.settings.tolerance
        held = self._stands.held >= self.settings.hold - STAMP_STEP
        return bool(there) and self._left and held and len(self._open) <= self.settings.batch

    def _go_to(self, leg: Leg, pose: PlannedPose) -> bool:
        """To a pose by its approach and a rest there; False when no free way leads to it: then it
        has left the sphere where it was."""
        speed = self.settings.approach_speed
        self._leave_sphere(leg)
        between = self._between(leg.here, pose)
        if between is None:
            return False
        visit(leg, pose, between, speed, self.settings.hold)
        return True

    def _leave_sphere(self, leg: Leg) -> None:
        """Along the approach, where the arm is on one."""
        back, standoff = self._retreat(leg.here)
        leg.along(back, standoff / self.settings.approach_speed)

    def _retreat(self, here: Array) -> tuple[Array, float]:
        """What to go by (K, n) away from a sphere, over how many m, where the arm is on its
        approach to one or has arrived."""
        for pose in reversed(self._visited):
            chain = np.vstack([pose.approach, pose.joints]) if len(pose.approach) else None
            if chain is None:
                continue
            for first in range(len(chain) - 2, -1, -1):
                if self._on(here, chain[first], chain[first + 1]):
                    return chain[first::-1], pose.standoff * (first + 1) / (len(chain) - 1)
        return np.empty((0, self._arm.n)), 0.0

    def _on(self, here: Array, one: Array, other: Array) -> bool:
        """Whether a posture is on the straight way between two."""
        way = other - one
        part = float(np.clip((here - one) @ way / (way @ way), 0.0, 1.0))
        return bool(np.abs(one + part * way - here).max() <= self.settings.tolerance)

    def _between(self, start: Array, pose: PlannedPose) -> Array | None:
        """What to go by from `start` to where a pose's approach begins: as the program says, or
        found anew where the arm is not where the program has it."""
        if self._way_to is None or not len(pose.approach):
            return pose.way[1:]
        for row, posture in enumerate(pose.way):  # it may have waited for the gauge on the way
            if np.abs(posture - start).max() <= self.settings.tolerance:
                return pose.way[row + 1 :]
        return self._way_to(start, pose)

    def _no_way(self, here: Array, pose: PlannedPose) -> str:
        """Why no way leads to a pose: the arm may stand where the gauge is to be."""
        touching = self._touching(here, pose) if self._touching is not None else ''
        return f'{NO_FREE_WAY}, {touching} where the arm stands' if touching else NO_FREE_WAY

    def _step_aside(self, leg: Leg) -> None:
        """Where the arm stands at the next pose already: without it there would be no new stop."""
        pose = self._todo[0][0]
        if not len(pose.approach) and self._at(pose, leg.here):
            leg.to(self._aside(leg.here))

    def _at(self, pose: PlannedPose, here: Array) -> bool:
        return bool(np.abs(here - pose.joints).max() <= self.settings.tolerance)

    def _aside(self, here: Array) -> Array:
        """A posture close by: an arm that never left makes no new stop."""
        lower, upper = self._arm.limits[-1]
        aside = here.copy()
        aside[-1] += -STEP_ASIDE if here[-1] > np.clip(0.0, lower, upper) else STEP_ASIDE
        return aside

    def see(self, joints: Array, stamp: int, now: float, wall: int = 0) -> None:
        """Take note of where the arm is at a stamp (ns), at `now` (s), as our own clock says `wall`
        (ns, 0: nobody knows); while it moves, answers can still come."""
        if self._stands.see(joints, stamp):
            self._sign_of_life = now
            self._left = True
        elif not self._heard:
            self._sign_of_life = now
        self._heard = True
        self.motion.see(joints, stamp, now, wall)
        self._here = joints

    def take(self, outcome: Outcome, now: float) -> TakenPose | None:
        """The accepted pose, None for a refusal and for a stop that nobody planned."""
        place = self._place_of(outcome.joints)
        if place is None:
            return None
        for pose, attempt in self._open[:place]:
            self._again(pose, attempt, NO_ANSWER)  # the arm has passed it by
        planned, attempt = self._open[place]
        self._open = self._open[place + 1 :]
        self._sign_of_life = self._progress = now
        if isinstance(outcome, Refusal):
            if outcome.reason in WORTH_ANOTHER_TRY:
                self._again(planned, attempt, outcome.reason.value)
            else:
                self._refuse(planned, outcome.reason.value)
            return None
        self.tally.taken += 1
        self.locations.take(planned.location)
        self.taken.append(TakenPose(planned, outcome))
        return self.taken[-1]

    def _place_of(self, joints: Array) -> int | None:
        for place, (pose, _) in enumerate(self._open):
            if np.abs(pose.joints - joints).max() <= self.settings.tolerance:
                return place
        return None

    def _again(self, pose: PlannedPose, attempt: int, reason: str) -> None:
        if attempt < self.settings.attempts:
            self._todo.appendleft((pose, attempt + 1))
        else:
            self._refuse(pose, reason)

    def _refuse(self, pose: PlannedPose, reason: str) -> None:
        """Count a pose as refused; another one of its sphere is tried in its place."""
        self.tally.refused[reason] += 1
        self.tally.refused_at[pose.location, pose.sphere, reason] += 1
        self.refused.append(pose)
        spares = self._spares[pose.location, pose.sphere]
        replaced = bool(spares) and reason != NO_ANSWER
        if replaced:
            self._todo.appendleft((spares.pop(0), 1))
            self.tally.replaced += 1
        self.locations.refuse(pose.location, reason, replaced)

    def overdue(self, now: float) -> bool:
        """Whether the open poses have gone without a sign of life for too long."""
        patience = self.settings.answer_timeout + self.settings.hold
        waits = bool(self._open) or self._poseless
        return waits and self._heard and now - self._sign_of_life > patience

    def refuse_standstill(self) -> None:
        """Nothing, where the arm has come to where it was commanded to.

        Raises:
            RunError: it has not; to be asked when there is no sign of life.
        """
        here = self._stands.mean
        if here is None or self._goal is None:
            return
        off = np.abs(here - self._goal)
        joint = int(np.argmax(off))
        if off[joint] <= self.settings.tolerance:
            return
        what = 'has stopped on the way' if self._left else 'has not moved since it was commanded'
        raise RunError(
            f'the arm does not follow: it {what}, {self._arm.joint_names[joint]} stands '
            f'{off[joint]:.3g} rad from its goal; see what the controller says'
        )

    def pause(self) -> None:
        """Command nothing any more; the open poses are to be tried again."""
        self.paused = True
        self._take_back()

    def arm_anew(self) -> None:
        """The arm has been started anew: what it was commanded died with it."""
        self.excuse()
        self._take_back()
        self.motion.forget()

    def _take_back(self) -> None:
        """Where it goes nobody knows any more; the open poses are to be tried again."""
        self._goal = None
        self._forget_way_out()
        self._todo.extendleft(reversed(self._open))
        self._open = []

    def go_on(self, now: float) -> None:
        """After a pause."""
        self.paused = False
        self._sign_of_life = self._progress = now

    @property
    def stands(self) -> tuple[Array | None, float]:
        """Where the arm stands (n,), and for how many s it has."""
        return self._stands.mean, self._stands.held

    def close_batch(self, now: float) -> None:
        """Give up waiting for the open poses; each is tried once more, then refused.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        self.give_up(now)
        for pose, attempt in reversed(self._open):
            self._again(pose, attempt, NO_ANSWER)
        self._open = []
        self._goal = None  # it may still be on its way
        self._forget_way_out()
        self._sign_of_life = now

    def _forget_way_out(self) -> None:
        self._poseless = False
        if self._gauge is not None:
            self._gauge.leaving = False

    def give_up(self, now: float) -> None:
        """Nothing, while there is hope.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        if now - self._progress > self.settings.give_up + self.settings.hold:
            raise RunError(
                f'no pose has been answered for {now - self._progress:.0f} s, giving up: '
                f'{self.tally.line()} of {self.tally.planned}'
            )

    def excuse(self) -> None:
        """What becomes of the open poses is not theirs to answer for: this attempt counts not."""
        self._open = [(pose, 0) for pose, _ in self._open]

    def seconds_left(self, now: float) -> float:
        """An estimate from the pace so far, s; before there is one, as the program was timed."""
        if not self.tally.done:
            return self._expected
        return (now - self._start) / self.tally.done * (self.tally.planned - self.tally.done)
