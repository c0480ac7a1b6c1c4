# SPDX-License-Identifier: Apache-2.0
"""One capture from waiting to closed bag, for the command and for the action alike."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from rclpy.executors import Executor

from calib_capture.measuring import RunError, SourceError, Tally
from calib_capture.nodes.capture.graph import TICK, CaptureNode
from calib_capture.nodes.capture.interventions import Carrying, Keys
from calib_capture.nodes.capture.parameters import CONTINUOUS
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.program import Program
from calib_capture.recording import (
    Begun,
    HandGuidedRecord,
    HandGuidedSession,
    HandGuidedTally,
    ProgramSession,
    TakenTally,
    TakingSession,
    begun,
    remaining,
)
from calib_capture.showing import RefusalNews
from calib_model.bags import read_note
from calib_model.errors import BagError, CalibrationError
from calib_model.instruments import PassiveProbe
from calib_model.pairing import HAND_GUIDED_NOTE
from calib_model.transforms import RigidTransform

READINGS_WITHIN = 2.0  # s after joint states in which somebody may yet tell of a passive probe
STOPPED_WITHIN = 3.0  # s in which an arm that was stopped is expected to stand
REMINDER = 3.0  # s between two lines that say what is being waited for


@dataclass(frozen=True)
class Watcher:
    """Who asked for the capture: hears lines and progress, and may want it to stop."""

    say: Callable[[str], None]
    show: Callable[[ProgramSession | HandGuidedSession | TakingSession], None]
    stopped: Callable[[], bool]


class Stopped(Exception):  # not an error: what was wished for
    """The capture was stopped; its argument is the summary."""


class Unfinished(Exception):  # not an error: it ran to its end
    """A location has fewer poses than were planned for it; the argument is the summary."""


class CaptureRun:
    """Waits for arm and probe, plans, measures; `tally` says how it went, also after an error."""

    def __init__(
        self, node: CaptureNode, executor: Executor, watcher: Watcher, showing: RunDisplay
    ) -> None:
        self._node = node
        self._executor = executor
        self._watcher = watcher
        self._showing = showing
        self.tally: Tally | HandGuidedTally | TakenTally = Tally(0)
        self._told = 0.0
        self._ends_told = 0
        self._places: Mapping[int, RigidTransform] = {}

    def __call__(self) -> str:
        """Do it; returns the summary.

        Raises:
            Stopped: the watcher wanted it so. The arm was told to stop and the bag is closed.
            Unfinished: a location could not be finished. The bag is closed.
            CalibrationError: it could not be done; a bag that was begun is closed.
        """
        node = self._node
        if Path(node.asked.output).exists() and not node.asked.resume:
            raise BagError(f'{node.asked.output}: exists already, a bag is never overwritten')
        self._wait_for(node.missing_descriptions)
        if node.asked.mode == CONTINUOUS:
            return self._led()
        node.commanding.refuse_rivals()
        node.describe()
        self._places = node.placements
        program = self._plan(node.asked.locations)
        if program is None:
            raise Stopped('nothing recorded')
        self._showing.program(program)
        for location, sphere in program.unreached:
            self._watcher.say(f'location {location}: sphere {sphere} is out of reach')
        there = self._there()
        left = remaining(program, there.poses)
        if there.taken:
            self._watcher.say(f'{node.asked.output}: {there.taken} poses are there already')
        if not left.poses and there.taken:
            return f'{node.asked.output}: complete with {there.taken} poses'
        self._showing.begin(there.poses)
        node.listen()
        try:
            node.commanding.take()
            self._wait_for(node.missing_streams)
            node.commanding.refuse_rivals()
            node.refuse_real_probe(left)
            return self._measure(left, there)
        finally:
            node.commanding.leave()

    def _wait_for(self, missing: Callable[[], str]) -> None:
        """Spin until nothing is missing."""
        begin = told = time.monotonic()
        while what := missing():
            self._node.check_origins()
            now = time.monotonic()
            if self._watcher.stopped():
                raise Stopped('nothing recorded')
            if now - begin > self._node.asked.wait_timeout:
                raise RunError(f'waited {now - begin:.0f} s in vain for {what}')
            if now - told > REMINDER:
                told = now
                self._watcher.say(f'waiting for {what}')
            self._executor.spin_once(timeout_sec=TICK)
        self._node.check_origins()

    def _remind(self) -> None:
        """Say now and then which stream has gone silent."""
        now = time.monotonic()
        if now - self._told > REMINDER and (what := self._node.silent()):
            self._told = now
            self._watcher.say(f'waiting for {what}')

    def _plan(self, locations: Sequence[int]) -> Program | None:
        """The program, made beside the graph: whoever asks meanwhile gets an answer. None when the
        watcher wanted it to stop."""
        node, planner, places = self._node, self._node.planner(), self._places
        planned = _Beside(lambda: node.timed(planner.program(places, locations)))
        while planned.is_alive():
            if self._watcher.stopped():
                return None
            self._executor.spin_once(timeout_sec=TICK)
        return planned.result()

    def _there(self) -> Begun:
        node = self._node
        if not Path(node.asked.output).exists():
            return Begun((), None)
        with node.asked.confined():
            there = begun(node.asked.output, node.arm, node.probe, node.gauge)
        for line in there.mended:
            self._watcher.say(line)
        return there

    def _measure(self, program: Program, there: Begun) -> str:
        node, begin = self._node, time.monotonic()
        session = node.begin(program, there.files, there.location)
        node.interventions.stop = node.interventions.carried = False
        carrying = Carrying(node.interventions, self._watcher.say)
        if node.asked.run.carried and len(session.run.to_come) > 1 and session.awaits is None:
            self._watcher.say(f'the bar is to stand at location {session.run.to_come[0]}')
        self.tally = session.tally
        stopped = at_rest = False
        news = RefusalNews()
        try:
            with session.recorder:
                while not (session.finished or stopped or node.failure):
                    self._executor.spin_once(timeout_sec=TICK)
                    self._remind()
                    self._watcher.show(session)
                    self._showing.progress(session)
                    for line in news.of(session.tally):
                        self._watcher.say(line)
                    self._tell_ended(session)
                    if carrying.done(session):
                        self._go_on(session, there, carrying)
                    stopped = self._watcher.stopped() or node.interventions.stop
                if not session.finished:
                    self._bring_to_rest()
                    at_rest = True
                session.finish()
        finally:
            if not (session.finished or at_rest):
                self._bring_to_rest()
            node.end()
        self._showing.progress(session, last=True)
        self._tell_ended(session)
        summary = self._summary(there, stopped, time.monotonic() - begin, session.remarks())
        short = [each for each in session.run.locations.ended if not each.finished]
        if short:
            numbers = ', '.join(str(each.location) for each in short)
            raise Unfinished(f'{summary}; not finished: location {numbers}')
        return summary

    def _tell_ended(self, session: ProgramSession) -> None:
        """Say of each location what came of it, when it is done with."""
        ended = session.run.locations.ended
        for location in ended[self._ends_told :]:
            if not location.finished or self._node.asked.run.carried:
                self._watcher.say(location.line())
        self._ends_told = len(ended)

    def _go_on(self, session: ProgramSession, there: Begun, carrying: Carrying) -> None:
        """The gauge was carried: to where it was taught, perhaps."""
        taught = self._node.taught.get(session.awaits or 0)
        if taught is not None and taught is not self._places.get(session.awaits or 0):
            self._watcher.say(f'location {session.awaits}: planned anew from what was taught')
            self._places = {**self._places, **self._node.taught}
            try:
                program = self._plan(session.run.to_come)
            except CalibrationError as error:
                self._watcher.say(str(error))
                carrying.ask_again()
                return
            if program is None:  # whoever asked sees to it
                return
            session.run.plan_anew(remaining(program, there.poses))
            self._showing.program(program)
        session.carried()

    def _bring_to_rest(self) -> None:
        """Stop the arm, whatever went wrong, and say where it stands."""
        node, end = self._node, time.monotonic() + STOPPED_WITHIN
        node.stop_arm()
        while node.stopping and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=TICK)
        where = node.where_it_stands()
        if node.stopping:
            where = f'the arm may still be moving: {node.silent() or where}'
        if where:
            self._watcher.say(where)

    def _led(self) -> str:
        """Take in a hand-guided arm; being stopped is the usual end of it."""
        node, begin = self._node, time.monotonic()
        node.describe()
        if isinstance(node.probe, PassiveProbe) and self._without_readings():
            return self._taking()
        self._showing.places()
        there, noted = self._there(), self._noted()
        if there.taken:
            self._watcher.say(f'{node.asked.output}: {there.taken} poses are there already')
        node.listen()
        self._wait_for(node.missing_streams)
        session = node.begin_hand_guided(there.files, noted)
        self.tally = session.tally
        try:
            with session.recorder:
                while not (session.finished or node.failure or self._watcher.stopped()):
                    self._executor.spin_once(timeout_sec=TICK)
                    self._remind()
                    self._watcher.show(session)
                session.finish()
        finally:
            node.end()
        return self._summary(there, False, time.monotonic() - begin, session.remarks())

    def _without_readings(self) -> bool:
        """Whether nobody tells of a passive probe, after a while in which somebody might."""
        self._node.listen()
        self._wait_for(self._node.missing_joints)
        until = time.monotonic() + READINGS_WITHIN
        while self._node.without_readings():
            if self._watcher.stopped():
                raise Stopped('nothing recorded')
            if time.monotonic() > until:
                return True
            self._executor.spin_once(timeout_sec=TICK)
        return False

    def _taking(self) -> str:
        """Take poses of a seated ball when asked to; being stopped is the usual end of it."""
        node, begin = self._node, time.monotonic()
        there = self._there()
        if there.taken:
            self._watcher.say(f'{node.asked.output}: {there.taken} poses are there already')
        session = node.begin_taking(there.files)
        self.tally = session.tally
        self._watcher.say(f'{node.probe.name} gives no readings: /capture/take takes a pose')
        keys, ended = Keys(self._watcher.say), False
        try:
            with session.recorder:
                while not (session.finished or node.failure or ended or self._watcher.stopped()):
                    self._executor.spin_once(timeout_sec=TICK)
                    self._remind()
                    self._watcher.show(session)
                    ended = keys.act(session)
                session.finish()
        finally:
            node.end()
        return self._summary(there, False, time.monotonic() - begin, session.remarks())

    def _noted(self) -> HandGuidedRecord:
        """What a hand-guided capture is asked for, or what its bag was begun with."""
        asked, output = self._node.asked, self._node.asked.output
        if Path(output).exists():
            with asked.confined():
                earlier = HandGuidedRecord.read(read_note(output, HAND_GUIDED_NOTE), output)
            if earlier is not None:
                return earlier
        self._node.refuse_assumed_places()
        placements = self._node.placements
        for number in asked.locations:
            if number not in placements:
                known = ', '.join(map(str, sorted(placements)))
                raise RunError(f'location {number} has no place (known: {known})')
        chosen = {number: placements[number] for number in asked.locations or sorted(placements)}
        return HandGuidedRecord(
            asked.moving, chosen, asked.program.spheres or self._node.gauge.spread()
        )

    def _summary(self, there: Begun, stopped: bool, seconds: float, remarks: str) -> str:
        output, failure = self._node.asked.output, self._node.failure
        whole = f', {there.taken + self.tally.taken} in all' if there.taken else ''
        remarks = ''.join(f'; {remark}' for remark in (self._node.lost(), remarks) if remark)
        summary = f'{output}: {self.tally.line()} in {seconds:.1f} s{whole}{remarks}'
        if stopped:
            raise Stopped(summary)
        if failure:
            silent = '' if isinstance(failure, SourceError) else self._node.silent()
            raise RunError(f'{output}: {failure}' + (f'; waited for {silent}' if silent else ''))
        if not self.tally.taken + there.taken:
            raise RunError(f'{output}: no pose was taken: {self.tally.line()}{remarks}')
        return summary


class _Beside(Thread):
    """Planning in a thread that nobody has to wait for, not even at the end of the process."""

    def __init__(self, work: Callable[[], Program]) -> None:
        super().__init__(daemon=True)
        self._work = work
        self._program: Program | None = None
        self._error: CalibrationError | None = None
        self.start()

    def run(self) -> None:
        """The thread's work."""
        try:
            self._program = self._work()
        except CalibrationError as error:
            self._error = error

    def result(self) -> Program:
        """The program, once the thread has ended; what it raised is raised again."""
        if self._error is not None:
            raise self._error
        assert self._program is not None, 'the planner failed, see above'
        return self._program
