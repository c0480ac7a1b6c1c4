# SPDX-License-Identifier: Apache-2.0
"""The capture node: `ros2 run calib_capture capture`."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from types import FrameType
from typing import Any

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.executors import Executor
from rclpy.parameter import Parameter

from calib_capture.measuring import Tally
from calib_capture.nodes.capture.action_server import CaptureServer
from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.nodes.capture.modes import capture_run
from calib_capture.nodes.capture.parameters import PROGRAM, ParameterReader
from calib_capture.nodes.capture.run import Stopped, Unfinished, Watcher
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.nodes.capture.teach_service import TeachService
from calib_capture.program import TaughtBook
from calib_capture.recording import Session
from calib_model.command_line import run_command
from calib_model.errors import ParameterError
from calib_model.nodes import NodeCommand, init, lean_executor, warn_of_unknown
from calib_model.progress import Progress
from calib_model.starting import INTERRUPTED, handle

ABOUT = """\
Runs a measuring program on the arm and the probe that it hears, and records the bag. With
serve:=true it waits for goals on /capture/run and for spheres taught on /capture/teach."""
EXAMPLE = """\
ros2 run calib_capture capture --ros-args -p output:=output/my_bag -p poses_per_sphere:=20
  ros2 run calib_capture capture --ros-args -p serve:=true
  ros2 action send_goal --feedback /capture/run calib_interfaces/action/Capture "{bag: my_bag}\""""

UNFINISHED = 1


class _Stop:
    """Remembers a signal, so that nothing is cut off in the middle of a write."""

    def __init__(self) -> None:
        self._signal = 0
        handle(self._note)

    def _note(self, number: int, _: FrameType | None) -> None:
        self._signal = number

    def asked(self) -> bool:
        """Whether there was one."""
        return bool(self._signal)


def _too_late(_: Sequence[Parameter]) -> SetParametersResult:
    return SetParametersResult(reason='the program runs as it was started: serve:=true takes goals')


def _run_once(node: CaptureNode, executor: Executor, stop: _Stop) -> int:
    """One run of the command, with a progress bar."""
    progress, showing = Progress(), RunDisplay(node)
    node.add_on_set_parameters_callback(_too_late)
    if node.asked.run.carried and node.asked.mode == PROGRAM:
        TeachService(node, showing).busy = True  # but while the gauge is carried
    else:
        node.taught.update(TaughtBook(node.asked.taught).read())

    def show(session: Session) -> None:
        tally, current, now = session.tally, session.run.current, time.monotonic()
        if current is not None:
            counts = f'{tally.so_far()}, ' if isinstance(tally, Tally) else ''
            where = f'{counts}location {current.location}, sphere {current.sphere}'
            left = session.run.seconds_left(now)
            progress.show(tally.done, tally.planned, left, where, now)

    try:
        progress.say(
            capture_run(node, executor, Watcher(progress.say, show, stop.asked), showing)()
        )
    except Stopped as stopped:
        progress.say(f'stopped: {stopped}')
        return INTERRUPTED
    except Unfinished as unfinished:
        progress.say(str(unfinished))
        return UNFINISHED
    return 0


def _read_parameters(node: Any) -> object:
    return ParameterReader(node).read()


COMMAND = NodeCommand('calib_capture', 'capture', ABOUT, EXAMPLE, _read_parameters)


def _capture() -> int:
    stop = _Stop()
    COMMAND.parse(sys.argv)
    init(sys.argv)
    node: CaptureNode | None = None
    try:
        node = CaptureNode()
        warn_of_unknown(node)
        executor = lean_executor()
        executor.add_node(node)
        if node.asked.serve:
            CaptureServer(node, executor, stop.asked).serve()
            return 0
        return _run_once(node, executor, stop)
    except InvalidParameterTypeException as error:
        raise ParameterError(str(error)) from error
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


def main() -> int:
    """Capture a measuring program into a bag, or serve; 2 when that cannot be done, 1 when a
    location has fewer poses than were planned."""
    return run_command(_capture)


if __name__ == '__main__':
    sys.exit(main())
