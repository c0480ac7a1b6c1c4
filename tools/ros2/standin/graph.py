# SPDX-License-Identifier: Apache-2.0
"""A node that looks at the graph, and what it sees there."""

import argparse
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from .command_line import Interrupted
from .nearest import nearest

PATIENCE = 2.0  # s; discovery that takes longer has failed
NamesAndTypes = list[tuple[str, list[str]]]


def add_discovery_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        '--spin-time',
        type=float,
        default=1.0,
        metavar='SPIN_TIME',
        help='Spin time in seconds to wait for discovery',
    )
    parser.add_argument(
        '--no-daemon',
        action='store_true',
        help='Accepted for likeness: there is never a daemon here',
    )


class Signals:
    """Remembers a signal until `wait_until` is between two turns.

    An exception out of a signal handler could end up in the middle of rclpy.
    """

    NUMBERS = (signal.SIGINT, signal.SIGTERM)

    def __init__(self) -> None:
        self._received: int | None = None

    def listen(self) -> None:
        for number in self.NUMBERS:
            if signal.getsignal(number) != signal.SIG_IGN:
                signal.signal(number, self._note)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._received = number
        # Who cannot wait for the end of what follows may signal once more.
        for each in self.NUMBERS:
            signal.signal(each, signal.SIG_DFL)

    def check(self) -> None:
        number, self._received = self._received, None
        if number is not None:
            raise Interrupted(number)


_signals = Signals()


@contextmanager
def graph_node(purpose: str = 'node', spin_time: float = 0.0) -> Iterator[Node]:
    """A hidden node that has listened to the graph for `spin_time` seconds.

    Where it would still be alone then, it listens for as long as it takes to be sure.
    """
    # rclpy's own handlers end the context at once; here a goal may have to be cancelled first.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    _signals.listen()
    node = rclpy.create_node(
        f'_ros2cli_{purpose}_{os.getpid()}', start_parameter_services=False, enable_rosout=False
    )
    try:
        wait_until(node, lambda: False, spin_time)
        if spin_time and not node_names(node):
            wait_for(node, lambda: node_names(node), PATIENCE)
        yield node
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def wait_until(node: Node, condition: Callable[[], bool], seconds: float) -> bool:
    """Spin until the condition holds; False where it does not within `seconds`.

    Raises:
        Interrupted: a signal came; waiting again is possible, for what has to be put in order.
    """
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() >= end:
            return False
        rclpy.spin_once(node, timeout_sec=0.05)
        _signals.check()
    return True


def wait_for(node: Node, find: Callable[[], Sequence[Any]], seconds: float) -> bool:
    """Wait for what `find` looks for, and a little longer for others of the same name."""
    found = wait_until(node, lambda: bool(find()), seconds)
    wait_until(node, lambda: False, 0.2 if found else 0.0)
    return found


def wait_for_server(
    node: Node,
    ready: Callable[[], bool],
    name: str,
    kind: str,
    wanted: str,
    listed: Callable[[], NamesAndTypes],
) -> None:
    """Wait for a service or an action for as long as it takes; say once what there is instead."""
    if wait_until(node, ready, PATIENCE):
        return
    known = dict(listed())
    # What is waited for stands in the list too, since somebody asks for it.
    others = set(known.pop(absolute(name), [])) - {wanted}
    there = f'; it is of type {", ".join(others)}' if others else nearest(absolute(name), known)
    print(f'no {kind} {name} of type {wanted} yet{there}', file=sys.stderr)
    wait_until(node, ready, math.inf)


def answer(node: Node, future: Any) -> Any:
    """Result of a request that a client has sent."""
    wait_until(node, future.done, math.inf)
    return future.result()


def node_names(node: Node, include_hidden: bool = False) -> list[str]:
    """Full names of the running nodes."""
    return sorted(
        f'{space.rstrip("/")}/{name}'
        for name, space in node.get_node_names_and_namespaces()
        if include_hidden or not name.startswith('_')
    )


def visible(names_and_types: NamesAndTypes, include_hidden: bool) -> NamesAndTypes:
    return [
        (name, types)
        for name, types in names_and_types
        if include_hidden or not topic_or_service_is_hidden(name)
    ]


def print_names(names_and_types: NamesAndTypes, show_types: bool, count_only: bool) -> None:
    if count_only:
        print(len(names_and_types))
        return
    for name, types in names_and_types:
        print(f'{name} [{", ".join(types)}]' if show_types else name)


def absolute(name: str) -> str:
    return name if name.startswith('/') else f'/{name}'
