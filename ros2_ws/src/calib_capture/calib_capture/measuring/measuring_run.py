# SPDX-License-Identifier: Apache-2.0
"""A measuring run: what to command next, what came of it, when it is over. Knows no graph."""

from __future__ import annotations

from calib_capture.measuring.commanded_motion import CommandedMotion
from calib_capture.measuring.locations import OneGauge
from calib_capture.measuring.patience import Patience
from calib_capture.measuring.pose_queue import PoseQueue, TakenPose
from calib_capture.measuring.pose_ways import PoseWays, Turns
from calib_capture.measuring.run_settings import RunSettings
from calib_capture.measuring.whereabouts import Whereabouts
from calib_capture.motion import Leg, Trajectory
from calib_capture.program import PlannedPose, Program
from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.pairing import Outcome, Refusal

STUCK = 1.5  # s that an arm stands on its way
STANDS = 0.1  # s before an arm counts as standing that nobody commanded there
RESTLESS = 3.0  # s, of ours and of its stamps, that such an arm may take to come to rest


class MeasuringRun:
    """Commands the poses of a program batch by batch and matches the outcomes to them.

    The next batch goes out when the arm has held the last pose of the one before, so that a
    trajectory never replaces one that is still needed; at most two batches wait for outcomes, so
    that no more readings are on their way than a subscriber keeps.

    One gauge that is carried stands `at` a location to begin with, at the program's first where
    none is given. All of a location is done, its spares too, then the arm goes out of the way, and
    `awaits` says where the gauge is to be carried, until it was `carried`. `turns` gives (n,)
    rad by which the joints turn at the first two poses and back, once these were held.
    """

    def __init__(
        self,
        arm: Arm,
        program: Program,
        settings: RunSettings,
        now: float,
        at: int | None = None,
        turns: Turns | None = None,
    ) -> None:
        self.settings = settings
        self.poses = PoseQueue(program, settings.attempts)
        self.tally, self.locations = self.poses.tally, self.poses.locations
        self.taken, self.refused = self.poses.taken, self.poses.refused
        self._ways = PoseWays(arm, program, settings, turns)
        self.where = Whereabouts(arm.joint_names, settings.tolerance)
        self.motion = CommandedMotion(settings.whole_limits(arm), settings.stamps)
        self.paused = False
        self._poseless = False  # whether it was last commanded to where no pose is
        self._restless_since: tuple[float, float] | None = None  # s, of ours and of its stamps
        self._patience = Patience(settings, self.tally, program.seconds, now)
        self._gauge: OneGauge | None = None
        if settings.carried and program.poses:
            first = program.poses[0].location
            self._gauge = OneGauge(at or first)
            if self._gauge.at != first:  # nothing moves before it is there
                self._gauge.wait(first, now, clear=False)

    @property
    def finished(self) -> bool:
        """Whether every pose has been taken or given up, and the arm is where it was sent."""
        return self.poses.done and not self._poseless

    @property
    def current(self) -> PlannedPose | None:
        """The pose that is being waited for."""
        return self.poses.current

    @property
    def to_come(self) -> tuple[int, ...]:
        """The locations of the poses that are left, in order."""
        return tuple(dict.fromkeys(pose.location for pose in self.poses.todo))

    def seconds_left(self, now: float) -> float:
        """An estimate from the pace so far, s; before there is one, as the program was timed."""
        return self._patience.seconds_left(now)

    def next_trajectory(self, now: float) -> Trajectory | None:
        """The next batch as a trajectory, None while the arm is busy with the last one."""
        if self.paused or self.awaits is not None or not self._free():
            return None
        self._poseless = False
        first = self.poses.next
        if first is None:
            return None
        if self._elsewhere(first):
            return self._out_of_the_way(first, now)
        leg = self._ways.begin(self.where.start, first)
        commanded = self._batch(leg)
        return self._commanded(leg, now, poseless=not commanded)

    def sent(self, trajectory: Trajectory, now: float) -> Trajectory:
        """The next batch as it is sent `now`: planning it took its time."""
        self._patience.alive(now)
        return self.motion.begin(trajectory, now)

    def _free(self) -> bool:
        """Whether the arm may be sent elsewhere."""
        where, waiting = self.where, self.poses.waiting
        if not where.known:
            return False
        if where.goal is None:  # it may still be coming to rest
            return self.motion.stopped and where.held >= STANDS
        if not waiting and not self._poseless:
            return True
        return waiting <= self.settings.batch and where.arrived(self.settings.hold)

    def _batch(self, leg: Leg) -> int:
        """To the next poses, as many as one command has; how many there are ways to."""
        commanded = 0
        while commanded < self.settings.batch and (pose := self.poses.next) is not None:
            if self._elsewhere(pose):
                break
            if self._ways.go_to(leg, pose):
                self.poses.command_next()
                commanded += 1
            else:
                self.poses.refuse_next(self._ways.why_not(leg.here, pose))
        return commanded

    def _commanded(self, leg: Leg, now: float, poseless: bool) -> Trajectory | None:
        if not leg.moves:
            return None
        self.where.commanded(leg.here)
        self._poseless = poseless
        self._patience.alive(now)
        return leg.trajectory()

    def see(self, joints: Array, stamp: int, now: float, wall: int = 0) -> None:
        """Take note of where the arm is at a stamp (ns), at `now` (s), as our own clock says `wall`
        (ns, 0: nobody knows); while it moves, answers can still come."""
        if self.where.see(joints, stamp):
            self._patience.alive(now)
        self.motion.see(joints, stamp, now, wall)

    def take(self, outcome: Outcome, now: float) -> TakenPose | None:
        """The accepted pose, None for a refusal and for a stop that nobody planned."""
        attempt = self.poses.stopped_at(outcome.joints, self.settings.tolerance)
        if attempt is None:
            return None
        self._patience.answered(now)
        if isinstance(outcome, Refusal):
            self.poses.refuse(attempt, outcome)
            return None
        return self.poses.accept(attempt, outcome)

    def overdue(self, now: float) -> bool:
        """Whether the open poses have gone without a sign of life for too long."""
        waits = bool(self.poses.waiting) or self._poseless
        return waits and self.where.heard and self._patience.overdue(now)

    def stuck(self, now: float) -> bool:
        """Whether the arm has stopped where nobody planned it to, and left its way far behind."""
        here = self.where.stands
        if here is None or not self.where.left or self.where.held < STUCK:
            return False
        if not self.motion.ought_to_move(now, STUCK):
            return False
        return not any(self.where.near(pose.joints, here) for pose in self.poses.open)

    def refuse_restless(self, now: float) -> None:
        """Nothing, while an arm that is on no way of ours may yet come to rest.

        Raises:
            RunError: it has had the time to.
        """
        where = self.where
        waits = where.known and where.goal is None and self.motion.stopped
        if not waits or where.held >= STANDS or self.paused or self.awaits is not None:
            self._restless_since = None
            return
        begun = self._restless_since = self._restless_since or (now, where.seconds)
        if min(now - begun[0], where.seconds - begun[1]) > RESTLESS:
            raise where.restless()

    def close_batch(self, now: float) -> None:
        """Give up waiting for the open poses; each is tried once more, then refused.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        self.give_up(now)
        self.poses.give_up_open()
        self._lose_arm()  # it may still be on its way
        self._patience.alive(now)

    def give_up(self, now: float) -> None:
        """Nothing, while there is hope.

        Raises:
            RunError: nothing has come of any pose for too long.
        """
        self._patience.give_up(now)

    def pause(self) -> None:
        """Command nothing any more; the open poses are to be tried again."""
        self.paused = True
        self._take_back()

    def go_on(self, now: float) -> None:
        """After a pause."""
        self.paused = False
        self._patience.answered(now)

    def arm_anew(self) -> None:
        """The arm has been started anew: what it was commanded died with it."""
        self.excuse()
        self._take_back()
        self.motion.forget()

    def excuse(self) -> None:
        """What becomes of the open poses is not theirs to answer for: this attempt counts not."""
        self._restless_since = None
        self.poses.excuse_open()

    def _take_back(self) -> None:
        self._lose_arm()
        self.poses.take_back_open()

    def _lose_arm(self) -> None:
        """Where it goes nobody knows any more."""
        self.where.lost()
        self._poseless = False
        if self._gauge is not None:
            self._gauge.leaving = False

    @property
    def awaits(self) -> int | None:
        """The location where the gauge is to be carried now."""
        return None if self._gauge is None else self._gauge.to

    @property
    def out_of_the_way(self) -> bool:
        """Whether the arm that awaits the gauge stands where it was planned to wait."""
        return self._gauge is not None and self._gauge.clear

    def carried(self, now: float) -> None:
        """The gauge stands where it was awaited; the arm may have been moved meanwhile."""
        assert self._gauge is not None
        self._patience.stood_still(self._gauge.carried(now))
        self._ways.forget()
        self._take_back()
        self._patience.answered(now)

    def plan_anew(self, program: Program) -> None:
        """Go on by this program in place of what is left of the one before; while the gauge is
        awaited."""
        self.poses.plan_anew(program)
        self._ways.plan_anew(program)

    def _elsewhere(self, pose: PlannedPose) -> bool:
        """Whether the gauge is to be carried before a pose."""
        return self._gauge is not None and pose.location != self._gauge.at

    def _out_of_the_way(self, first: PlannedPose, now: float) -> Trajectory | None:
        """To where the gauge can be carried to the `first` pose of the next location, once all
        poses of where it stands have an outcome; None when the arm is there, or there is no free
        way: then it has left the sphere at least."""
        gauge, start = self._gauge, self.where.start
        assert gauge is not None
        if self.poses.waiting:
            return None
        if not gauge.leaving:
            leg = self._ways.leg(start)
            self._ways.leave_location(leg, gauge.at, first)
            far = not self.where.near(leg.here, start)
            if far and (trajectory := self._commanded(leg, now, poseless=True)) is not None:
                gauge.leaving = True
                return trajectory
        gauge.wait(first.location, now, self._ways.at_rest(start))
        return None
