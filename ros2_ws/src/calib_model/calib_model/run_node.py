# SPDX-License-Identifier: Apache-2.0
"""A node's life as a command: start, work, and end when told to, between two callbacks."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from types import FrameType

import rclpy
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from calib_model.errors import ParameterError

WAKE_PERIOD = 0.1  # s, how soon an idle node sees that it is to end


class _Stop:
    """Set by the first SIGINT or SIGTERM; the second does what it does by default."""

    def __init__(self) -> None:
        self.asked = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._ask)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
        signal.signal(number, signal.SIG_DFL)


def run_node(
    make: Callable[[], Node], executor: Callable[[], Executor] = SingleThreadedExecutor
) -> None:
    """Run the node that `make` returns until SIGINT or SIGTERM.

    rclpy's own handler of SIGTERM shuts the context down from a thread of its own, whatever the
    node is doing: now and then a traceback, now and then a wait without end. Here a signal is a
    wish that the main loop grants.

    Raises:
        ParameterError: arguments that rcl cannot parse, parameters that the node refuses.
    """
    stop = _Stop()
    try:
        rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # what rcl raises for arguments that it cannot parse
        raise ParameterError(str(error).partition(', at ')[0]) from error
    try:
        _spin(make(), executor(), stop)
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise ParameterError(str(error)) from error
    finally:
        rclpy.try_shutdown()


def _spin(node: Node, executor: Executor, stop: _Stop) -> None:
    # Python sees a signal only between two waits, so there has to be an end to each
    node.create_timer(WAKE_PERIOD, lambda: None, clock=Clock(clock_type=ClockType.STEADY_TIME))
    executor.add_node(node)
    try:
        while not stop.asked:
            executor.spin_once(WAKE_PERIOD)
    finally:
        executor.shutdown()
        node.destroy_node()
