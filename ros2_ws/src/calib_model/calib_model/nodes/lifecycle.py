# SPDX-License-Identifier: Apache-2.0
"""A node's life as a command: start, work, and end when told to, between two callbacks."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from types import FrameType
from typing import Any

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from calib_model.command_line import CommandParser, UsageError
from calib_model.errors import ParameterError
from calib_model.nodes.parameters import Sheet, warn_of_unknown
from calib_model.starting import end_at_the_latest, handle

MOST_DOMAIN = 232
TWICE = 2.0  # s within which signals count as one
LAST_CALLBACKS = 0.05  # s for those that a pool of threads has begun, before all is taken down
WAKE_PERIOD = 0.1  # s, how soon an idle node sees that it is to end


@dataclass(frozen=True)
class NodeCommand:
    """A node on the command line: `ros2 run PACKAGE NAME`.

    `declare` declares its parameters on what it is given, for `--help` to tell of them.
    """

    package: str
    name: str
    about: str
    example: str
    declare: Callable[[Any], object]

    def parse(self, argv: list[str]) -> None:
        """Say `--help` where it is asked for, and leave.

        Raises:
            UsageError: an argument that is neither ROS's nor ours.
        """
        refuse_other_encodings(argv)
        try:
            given = remove_ros_args(argv)[1:]
        except RuntimeError:  # rcl's; it says it better when the node starts
            return
        sheet = Sheet()
        if given:
            self.declare(sheet)
        end = f'{sheet.text()}\n\nexample:\n  {self.example}'
        parser = CommandParser(self.name, self.about, end)
        parser.usage = f'ros2 run {self.package} {self.name} [-h] [--ros-args -p NAME:=VALUE ...]'
        parser.parse_args(given)


def refuse_other_encodings(argv: list[str]) -> None:
    """Raise where rcl would: it takes UTF-8 alone, also for the names of files.

    Raises:
        UsageError: names the argument.
    """
    for word in argv:
        try:
            word.encode()
        except UnicodeEncodeError as error:
            raise UsageError(f'argument {word!r}: expected UTF-8') from error


def init(argv: list[str]) -> None:
    """Start rclpy without its signal handlers.

    Raises:
        ParameterError: arguments that rcl cannot parse.
    """
    domain = os.environ.get('ROS_DOMAIN_ID', '')
    if domain.isdecimal() and int(domain[:9]) > MOST_DOMAIN:
        # Fast DDS would end the process where it stands
        raise ParameterError(f'ROS_DOMAIN_ID: expected 0 to {MOST_DOMAIN}, got {domain[:40]}')
    try:
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rcl raises for arguments that it cannot parse
        raise ParameterError(str(error).partition(', at ')[0]) from error


class _Stop:
    """Set by the first SIGINT, SIGTERM or SIGHUP; a later one does what it does by default.

    Ctrl-C in a terminal comes twice to what `ros2 launch` has started: from the terminal, and from
    launch.
    """

    def __init__(self) -> None:
        self.asked = False
        self._since = 0.0
        handle(self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        now = time.monotonic()
        if self.asked and now - self._since > TWICE:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
        elif not self.asked:
            self.asked, self._since = True, now
            end_at_the_latest()


def run_node(
    command: NodeCommand,
    make: Callable[[], Node],
    executor: Callable[[], Executor] = SingleThreadedExecutor,
    end_work: Callable[[Any], None] | None = None,
) -> None:
    """Run the node that `make` returns until SIGINT or SIGTERM, or say `--help`.

    `end_work` of the node ends what its callbacks are at, before it is taken down.

    rclpy's own handler of SIGTERM shuts the context down from a thread of its own, whatever the
    node is doing: now and then a traceback, now and then a wait without end. Here a signal is a
    wish that the main loop grants.

    Raises:
        ParameterError: arguments that rcl cannot parse, parameters that the node refuses.
        UsageError: arguments that nobody takes.
    """
    stop = _Stop()
    command.parse(sys.argv)
    init(sys.argv)
    try:
        _spin(make(), executor(), stop, end_work)
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise ParameterError(str(error)) from error
    finally:
        rclpy.try_shutdown()


def _spin(
    node: Node, executor: Executor, stop: _Stop, end_work: Callable[[Any], None] | None
) -> None:
    warn_of_unknown(node)
    # Python sees a signal only between two waits, so there has to be an end to each
    node.create_timer(WAKE_PERIOD, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))
    executor.add_node(node)
    try:
        while not stop.asked:
            executor.spin_once(WAKE_PERIOD)
    finally:
        if end_work is not None:
            end_work(node)
        time.sleep(LAST_CALLBACKS)
        executor.shutdown()
        node.destroy_node()


def lean_executor() -> Executor:
    """rclpy's events executor where this rclpy has it: a third of the time per message.

    It wants `spin_once` with a timeout: without one, a shutdown from a signal does not end it.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:  # an earlier rclpy of Jazzy
        return SingleThreadedExecutor()
    executor: Executor = EventsExecutor()
    return executor
