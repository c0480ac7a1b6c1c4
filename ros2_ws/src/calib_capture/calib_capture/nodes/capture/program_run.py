# SPDX-License-Identifier: Apache-2.0
"""A capture that commands the arm by a measuring program."""

from __future__ import annotations

import time
from collections.abc import Mapping

from rclpy.executors import Executor

from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.nodes.capture.interventions import Carrying
from calib_capture.nodes.capture.planning import Planning
from calib_capture.nodes.capture.run import CaptureRun, Stopped, Unfinished, Watcher
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.program import Program, shortfall
from calib_capture.recording import Begun, ProgramSession, remaining
from calib_capture.showing import RefusalNews
from calib_model.errors import CalibrationError
from calib_model.transforms import RigidTransform

STOPPED_WITHIN = 3.0  # s in which an arm that was stopped is expected to stand


class ProgramRun(CaptureRun):
    """Plans, waits for arm and probe, measures location after location."""

    def __init__(
        self, node: CaptureNode, executor: Executor, watcher: Watcher, showing: RunDisplay
    ) -> None:
        super().__init__(node, executor, watcher, showing)
        self._plan = Planning(node, self._spin, watcher.stopped)
        self._ends_told = 0
        self._places: Mapping[int, RigidTransform] = {}

    def _captured(self) -> str:
        node = self._node
        node.commanding.refuse_rivals()
        node.describe()
        self._places = node.placements
        program = self._plan(self._places, node.asked.locations)
        if program is None:
            raise Stopped('nothing recorded')
        self._showing.program(program)
        asked = node.asked.program
        if few := shortfall(program, asked.poses_per_sphere, asked.standing):
            self._watcher.say(few)
        for location, sphere in program.unreached:
            self._watcher.say(f'location {location}: sphere {sphere} is out of reach')
        there = self._there()
        left = remaining(program, there.poses)
        if not left.poses and there.taken:
            return f'{node.asked.output}: complete with {there.taken} poses'
        self._showing.begin(there.poses)
        node.listen()
        try:
            node.commanding.take()
            self._wait_for(node.missing_streams)
            node.commanding.refuse_rivals()
            self._plan.refuse_real_probe(left)
            return self._measured(left, there)
        finally:
            node.commanding.leave()

    def _measured(self, program: Program, there: Begun) -> str:
        node, begin = self._node, time.monotonic()
        session = node.begin(program, there.files, there.location)
        self.tally = session.tally
        at_rest = False
        try:
            with session.recorder:
                stopped = self._until_over(session, there)
                if not session.finished:
                    self._bring_to_rest(session)
                    at_rest = True
                session.finish()
        finally:
            if not (session.finished or at_rest):
                self._bring_to_rest(session)
            node.end()
        self._showing.progress(session, last=True)
        self._tell_ended(session)
        summary = self._summary(there, stopped, time.monotonic() - begin, session.remarks())
        short = [each for each in session.run.locations.ended if not each.finished]
        if short:
            numbers = ', '.join(str(each.location) for each in short)
            raise Unfinished(f'{summary}; not finished: location {numbers}')
        return summary

    def _until_over(self, session: ProgramSession, there: Begun) -> bool:
        """Measure until all is done, or it fails or is stopped; whether somebody stopped it."""
        node, stopped, news = self._node, False, RefusalNews()
        node.interventions.stop = node.interventions.carried = False
        carrying = Carrying(node.interventions, self._watcher.say)
        if node.asked.run.carried and len(session.run.to_come) > 1 and session.awaits is None:
            self._watcher.say(f'the bar is to stand at location {session.run.to_come[0]}')

        def over() -> bool:
            return session.finished or node.failure is not None or node.interventions.stop

        while not (over() or stopped):
            self._spin(over)
            self._remind()
            self._watcher.show(session)
            self._showing.progress(session)
            for line in news.of(session.tally):
                self._watcher.say(line)
            self._tell_ended(session)
            if carrying.done(session):
                self._go_on(session, there, carrying)
            stopped = self._watcher.stopped()
        return stopped or node.interventions.stop

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
                program = self._plan(self._places, session.run.to_come)
            except CalibrationError as error:
                self._watcher.say(str(error))
                carrying.ask_again()
                return
            if program is None:  # whoever asked sees to it
                return
            session.run.plan_anew(remaining(program, there.poses))
            self._showing.program(program)
        session.carried()

    def _bring_to_rest(self, session: ProgramSession) -> None:
        """Stop the arm, whatever went wrong, and say where it stands."""
        end = time.monotonic() + STOPPED_WITHIN
        session.halt()
        while session.stopping and time.monotonic() < end:
            self._spin()
        where = self._where_it_stands(session)
        if session.stopping:
            where = f'the arm may still be moving: {self._node.streams.silent() or where}'
        if where:
            self._watcher.say(where)

    def _where_it_stands(self, session: ProgramSession) -> str:
        """The joints, in words; empty where nothing was heard of them."""
        here = session.run.where.stands
        if here is None:
            return ''
        named = zip(self._node.arm.joint_names, here, strict=True)
        joints = ', '.join(f'{name} {value:.4f}' for name, value in named)
        return f'the arm stands at {joints} rad'
