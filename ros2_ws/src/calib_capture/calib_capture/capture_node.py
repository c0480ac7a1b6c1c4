# SPDX-License-Identifier: Apache-2.0
"""The capture node: `ros2 run calib_capture capture`."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import FrameType

import rclpy
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.signals import SignalHandlerOptions

from calib_capture.executor_node import lean_executor
from calib_capture.measuring_node import TICK, CaptureNode
from calib_capture.program import Program
from calib_capture.run import RunError
from calib_capture.session import CaptureSession
from calib_model.command import run_command
from calib_model.errors import BagError, ParameterError
from calib_model.progress import Progress

REMINDER = 3.0  # s between two lines that say what is being waited for
INTERRUPTED = 128  # plus the signal's number: the shell's exit code for it


class _Stop:
    """Remembers a signal, so that nothing is cut off in the middle of a write."""

    def __init__(self) -> None:
        self.signal = 0
        signal.signal(signal.SIGINT, self._note)
        signal.signal(signal.SIGTERM, self._note)

    def _note(self, number: int, _: FrameType | None) -> None:
        self.signal = number


class Command:
    """One run of the command: waits, plans, measures, and says how it went."""

    def __init__(self, node: CaptureNode) -> None:
        self._node = node
        self._progress = Progress()
        self._stop = _Stop()
        self._executor = lean_executor()
        self._executor.add_node(node)

    def __call__(self) -> int:
        node = self._node
        if Path(node.asked.output).exists():
            raise BagError(f'{node.asked.output}: exists already, a bag is never overwritten')
        if not self._wait_for(node.missing_descriptions):
            return self._interrupted('nothing recorded')
        program = node.plan()
        for location, sphere in program.unreached:
            self._progress.say(f'location {location}: sphere {sphere} is out of reach')
        node.listen()
        if not self._wait_for(node.missing_streams):
            return self._interrupted('nothing recorded')
        return self._measure(program)

    def _wait_for(self, missing: Callable[[], str]) -> bool:
        """Spin until nothing is missing; False when told to stop."""
        begin = told = time.monotonic()
        while what := missing():
            now = time.monotonic()
            if self._stop.signal:
                return False
            if now - begin > self._node.asked.wait_timeout:
                raise RunError(f'waited {now - begin:.0f} s in vain for {what}')
            if now - told > REMINDER:
                told = now
                self._progress.say(f'waiting for {what}')
            self._executor.spin_once(timeout_sec=TICK)
        return True

    def _measure(self, program: Program) -> int:
        node, begin = self._node, time.monotonic()
        session = node.begin(program)
        with session.recorder:
            while not (session.finished or self._stop.signal or node.failure):
                self._executor.spin_once(timeout_sec=TICK)
                self._show(session)
            if not session.finished:
                node.stop_arm()
        seconds = time.monotonic() - begin
        summary = f'{node.asked.output}: {session.tally.line()} in {seconds:.1f} s'
        if self._stop.signal:
            return self._interrupted(summary)
        if node.failure:
            raise RunError(f'{node.asked.output}: {node.failure}')
        self._progress.say(summary)
        if not session.tally.taken:
            raise RunError(f'{node.asked.output}: no pose was taken')
        return 0

    def _show(self, session: CaptureSession) -> None:
        tally, current, now = session.tally, session.run.current, time.monotonic()
        if current is not None:
            where = f'location {current.location}, sphere {current.sphere}'
            left = session.run.seconds_left(now)
            self._progress.show(tally.done, tally.planned, left, where, now)

    def _interrupted(self, summary: str) -> int:
        self._progress.say(f'stopped: {summary}')
        return INTERRUPTED + self._stop.signal


def _capture() -> int:
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rcl raises for arguments it cannot parse
        raise ParameterError(str(error).partition(', at ')[0]) from error
    node: CaptureNode | None = None
    try:
        node = CaptureNode()
        return Command(node)()
    except InvalidParameterTypeException as error:
        raise ParameterError(str(error)) from error
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Capture a measuring program into a bag; 2 when that cannot be done."""
    return run_command(_capture)


if __name__ == '__main__':
    sys.exit(main())
