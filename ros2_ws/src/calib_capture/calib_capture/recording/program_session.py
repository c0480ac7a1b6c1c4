# SPDX-License-Identifier: Apache-2.0
"""One measuring run from streams to bag: pairing, run and recorder put together."""

from __future__ import annotations

from collections.abc import Callable

from calib_capture.measuring import MeasuringRun, RunError, Tally
from calib_capture.motion import Trajectory
from calib_capture.recording.hand_guided_record import CLOCK_NOTE, apart, clock_content, clock_line
from calib_capture.recording.recorder import Recorder
from calib_model.bags import cdr
from calib_model.pairing import ClockEstimate, JointSample, Outcome, Pairing, Reading
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, Topic

Clock = Callable[[], float]
BACK = 'stamps of the joints began anew: {}'
UNSURE = '{} messages left out around a publisher started anew'
FRESH = 0.3  # s since the last joint state: what it tells holds now
STALE = 1.0  # s without a message of one stream: it is waited for, the arm told nothing
AT_REST = 0.1  # s that an arm has stood still before it counts as stopped
SAVE_WITHIN = 0.05  # s: accepted poses that come closer together share a flush


class ProgramSession:
    """Feeds both streams to the pairing and the bag, and the outcomes to the run.

    `command` is called with each next trajectory; `clock` gives seconds, `wall` ns for the bag.
    An `estimate` sees both streams and tells at the end how far apart their clocks are.
    """

    def __init__(
        self,
        run: MeasuringRun,
        pairing: Pairing,
        recorder: Recorder,
        frame: str,
        command: Callable[[Trajectory], None],
        clock: Clock,
        wall: Callable[[], int],
        estimate: ClockEstimate | None = None,
    ) -> None:
        self.run = run
        self.pairing = pairing
        self.recorder = recorder
        self._frame = frame
        self._command = command
        self._clock = clock
        self._wall = wall
        self._unsaved_since: float | None = None
        self._estimate = estimate
        self._newest = [0, 0]
        self._fresh = [clock(), clock()]
        self._clock_line = ''
        self._halting = self._lost = self._paused = False
        self.unsure = 0  # messages that came while nobody knew from whom

    @property
    def finished(self) -> bool:
        """Whether every pose has been taken or given up."""
        return self.run.finished

    @property
    def tally(self) -> Tally:
        """How the run is going."""
        return self.run.tally

    def take_joints(self, sample: JointSample, raw: bytes) -> None:
        """A joint state has come; `raw` are its CDR bytes."""
        now, wall = self._clock(), self._wall()
        self.recorder.raw(JOINT_STATES, raw, wall)
        self._newest[0], self._fresh[0] = sample.stamp, now
        if self._estimate is not None:
            self._estimate.see_joints(sample)
        self.run.see(sample.joints, sample.stamp, now, wall)
        self._go_on(self.pairing.add_joints(sample), now)

    def take_reading(self, reading: Reading, raw: bytes) -> None:
        """A probe reading has come; `raw` are its CDR bytes."""
        now = self._clock()
        self.recorder.raw(PROBE_DISPLACEMENTS, raw, self._wall())
        self._newest[1], self._fresh[1] = reading.stamp, now
        if self._estimate is not None:
            self._estimate.see_reading(reading)
        if outcomes := self.pairing.add_reading(reading):  # else it changes nothing
            self._go_on(outcomes, now)

    def start_over(self, topic: Topic) -> None:
        """A message has come that may be of another arm or probe than the bag's: it is left out of
        the bag, too, so that nobody pairs it later."""
        self.unsure += 1
        self.pairing.start_over()
        if topic == JOINT_STATES:
            self.run.arm_anew()
        else:
            self.run.excuse()

    def tick(self) -> None:
        """Do what is due without a message: save, give up waiting, command.

        Raises:
            RunError: nothing has come of any pose for too long, or the arm does not come to rest.
        """
        now = self._clock()
        if self._stale(now):
            if not self._lost and self.run.motion.under_way(now):
                self._lost = True
                self.halt()
            self.run.excuse()
            if not self._paused and self.run.awaits is None:
                self._named(self.run.give_up, now)
        elif self._lost:
            self._lost = False
            if not self._paused:
                self.run.go_on(now)
        self.run.refuse_restless(now)
        if self._halting:
            self._stop_arm(now)
        if self.run.stuck(now) and not self._stale(now):
            self.run.where.refuse_standstill()
        if self.run.overdue(now):
            self._take(self.pairing.finish(), now)
            if now - self._fresh[0] < FRESH:
                self.run.where.refuse_standstill()
            self._named(self.run.close_batch, now)
        self._go_on([], now)

    def halt(self) -> None:
        """Bring the arm to rest, and command nothing until the run goes on."""
        self.run.pause()
        self._halting = True
        self._stop_arm(self._clock())

    def pause(self) -> None:
        """Bring the arm to rest until somebody says to go on."""
        self._paused = True
        self.halt()

    def go_on(self) -> bool:
        """After a pause; False when there was none."""
        if not self._paused:
            return False
        self._paused = False
        self.run.go_on(self._clock())
        return True

    @property
    def awaits(self) -> int | None:
        """The location where the gauge is to be carried before anything moves again."""
        return None if self._halting else self.run.awaits

    def carried(self) -> None:
        """The gauge stands where it was awaited."""
        self.run.carried(self._clock())

    def go_on_halting(self) -> None:
        """What a tick does for an arm that is to stop, and no more."""
        if self._halting:
            self._stop_arm(self._clock())

    @property
    def stopping(self) -> bool:
        """Whether an arm that was halted is still to be stopped, or still moves."""
        return self._halting or self.run.where.held < AT_REST

    def _stop_arm(self, now: float) -> None:
        motion = self.run.motion
        if not motion.under_way(now):
            self._halting = False
        elif (trajectory := motion.stop(now)) is not None:
            self._command(trajectory)
            self._halting = False

    def finish(self) -> None:
        """Note what the streams told of their clocks; no more messages are coming."""
        if self._estimate is None:
            return
        self._estimate.finish()
        found = self._estimate.estimate()
        if found is not None:
            self.recorder.note(CLOCK_NOTE, clock_content(found, 0))
            self._clock_line = clock_line(found, 0)

    def remarks(self) -> str:
        """What there is to say at the end, beside the counts; may be empty."""
        late, back = self.pairing.too_late, self.pairing.steps_back
        parts = [f'{late} messages out of order'] if late else []
        parts += [BACK.format(back)] if back else []
        parts += [UNSURE.format(self.unsure)] if self.unsure else []
        return '; '.join([*parts, self._clock_line] if self._clock_line else parts)

    def _stale(self, now: float) -> bool:
        return now - min(self._fresh) > STALE

    def _named(self, work: Callable[[float], None], now: float) -> None:
        """Do it; what is raised says how far the clocks are apart."""
        try:
            work(now)
        except RunError as error:
            raise RunError(f'{error}{apart(*self._newest)}') from error

    def _go_on(self, outcomes: list[Outcome], now: float) -> None:
        self._take(outcomes, now)
        waits = self._halting or self._stale(now)
        trajectory = None if waits else self.run.next_trajectory(now)
        if trajectory is not None:
            self._command(self.run.sent(trajectory, self._clock()))
        since = self._unsaved_since
        if since is not None and (self.run.finished or self._clock() - since > SAVE_WITHIN):
            self._save()

    def _take(self, outcomes: list[Outcome], now: float) -> None:
        for outcome in outcomes:
            taken = self.run.take(outcome, now)
            if taken is None:
                continue
            planned, measured = taken.planned, taken.measured
            message = cdr.probing_pose(
                measured.stamp,
                self._frame,
                planned.location,
                planned.sphere,
                measured.joints,
                measured.displacement,
                measured.readings,
            )
            self.recorder.pose(cdr.encode(message), self._wall())
            self._unsaved_since = self._unsaved_since or now

    def _save(self) -> None:
        self.recorder.commit()
        self._unsaved_since = None
