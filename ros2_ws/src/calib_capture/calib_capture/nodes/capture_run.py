# SPDX-License-Identifier: Apache-2.0
"""One capture from waiting to closed bag, for the command and for the action alike."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from threading import Thread

from rclpy.executors import Executor

from calib_capture.nodes.capture_graph import TICK, CaptureNode
from calib_capture.nodes.marker_publisher import MarkerPublisher
from calib_capture.nodes.parameters import CONTINUOUS
from calib_capture.nodes.taking import Keys
from calib_capture.program import Program
from calib_capture.recording import (
    Begun,
    HandGuidedRecord,
    HandGuidedSession,
    HandGuidedTally,
    ProgramSession,
    RunError,
    SourceError,
    TakenTally,
    TakingSession,
    Tally,
    begun,
    remaining,
)
from calib_model.bags import read_note
from calib_model.errors import BagError, CalibrationError
from calib_model.instruments import PassiveProbe
from calib_model.pairing import HAND_GUIDED_NOTE

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


class CaptureRun:
    """Waits for arm and probe, plans, measures; `tally` says how it went, also after an error."""

    def __init__(
        self, node: CaptureNode, executor: Executor, watcher: Watcher, showing: MarkerPublisher
    ) -> None:
        self._node = node
        self._executor = executor
        self._watcher = watcher
        self._showing = showing
        self.tally: Tally | HandGuidedTally | TakenTally = Tally(0)
        self._told = 0.0

    def __call__(self) -> str:
        """Do it; returns the summary.

        Raises:
            Stopped: the watcher wanted it so. The arm was told to stop and the bag is closed.
            CalibrationError: it could not be done; a bag that was begun is closed.
        """
        node = self._node
        if Path(node.asked.output).exists() and not node.asked.resume:
            raise BagError(f'{node.asked.output}: exists already, a bag is never overwritten')
        self._wait_for(node.missing_descriptions)
        if node.asked.mode == CONTINUOUS:
            return self._led()
        node.commanding.refuse_rivals()
        program = self._plan()
        self._showing.program(program)
        for location, sphere in program.unreached:
            self._watcher.say(f'location {location}: sphere {sphere} is out of reach')
        there = self._there()
        left = remaining(program, there.poses)
        if there.taken:
            self._watcher.say(f'{node.asked.output}: {there.taken} poses are there already')
        if not left.poses and there.taken:
            return f'{node.asked.output}: complete with {there.taken} poses'
        node.listen()
        try:
            node.commanding.take()
            self._wait_for(node.missing_streams)
            node.commanding.refuse_rivals()
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

    def _plan(self) -> Program:
        """The program, made beside the graph: whoever asks meanwhile gets an answer."""
        node = self._node
        node.describe()
        planner = node.planner()
        placements, locations = node.placements, node.asked.locations
        planned = _Beside(lambda: planner.program(placements, locations))
        while planned.is_alive():
            if self._watcher.stopped():
                raise Stopped('nothing recorded')
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
        session = node.begin(program, there.files)
        node.interventions.stop = False
        self.tally = session.tally
        stopped = False
        try:
            with session.recorder:
                while not (session.finished or stopped or node.failure):
                    self._executor.spin_once(timeout_sec=TICK)
                    self._remind()
                    self._watcher.show(session)
                    self._showing.progress(session)
                    stopped = self._watcher.stopped() or node.interventions.stop
                session.finish()
        finally:
            if not session.finished:
                self._bring_to_rest()
            node.end()
        self._showing.progress(session, last=True)
        return self._summary(there, stopped, time.monotonic() - begin, session.remarks())

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
