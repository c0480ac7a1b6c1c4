# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture replay`: a recorded bag back on its topics, as it was."""

from __future__ import annotations

import importlib
import re
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from ament_index_python import has_resource
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock

from calib_capture.replaying import OfferedQos, Playback, Timing, offered_qos, read_playback
from calib_model.bags import BagMessage
from calib_model.command_line import CommandParser, number_from, run_command
from calib_model.errors import BagError, ParameterError
from calib_model.nodes import init, refuse_other_encodings, warn_of_unknown
from calib_model.progress import Pace, Progress

SETTLED = 0.3  # s without a new subscriber after which those that will listen are taken to be there
DELIVERY = 2.0  # s to wait at the end for what reliable subscribers have not acknowledged

ABOUT = """\
Play a recorded bag back onto its topics, with the QoS and in the time order of the recording;
latched descriptions come first. A bag that was cut short is played as far as it goes. Trajectories
that an arm was sent are left out: one that listens would move."""

EXAMPLE = """\
example:
  ros2 run calib_capture replay output/demo/bag --rate 5 --clock"""


class ReplayNode(Node):
    """Publishers for everything in a bag."""

    def __init__(self, playback: Playback, clock: bool) -> None:
        super().__init__('replay')
        self._playback = playback
        self._topics: dict[str, Any] = {}
        for message in playback.topics:
            self._offer(message)
        for topic in playback.commands:
            self.get_logger().info(f'{topic} is left out: an arm that listens would move')
        self._clock = self.create_publisher(Clock, '/clock', 10) if clock else None

    def _offer(self, message: BagMessage) -> None:
        kind = _message_class(message.type)
        if kind is None:
            found = message.type or 'no schema'
            self.get_logger().warning(f'{message.topic} is left out: {found} is not installed')
            return
        qos = _profile(offered_qos(message.offered_qos))
        self._topics[message.topic] = self.create_publisher(kind, message.topic.lstrip('/'), qos)

    @property
    def playable(self) -> bool:
        """Whether there is a topic that can be published."""
        return bool(self._topics)

    def wait_for_subscribers(self, longest: float) -> int:
        """Give those who listen the time to be discovered; how many there are.

        Returns once no new one has come for a while, at the latest after `longest` s.
        """
        end = time.monotonic() + longest
        count, since = 0, time.monotonic()
        while time.monotonic() < end:
            seen = sum(topic.get_subscription_count() for topic in self._topics.values())
            if seen != count:
                count, since = seen, time.monotonic()
            elif count and time.monotonic() - since > SETTLED:
                break
            time.sleep(0.02)
        return count

    def play(self, rate: float, progress: Played) -> None:
        """Publish everything once, at `rate` times the recorded speed."""
        for message in self._playback.latched:
            self._publish(message)
        start, _ = self._playback.span
        timing = Timing(start, rate, self._tick if self._clock is not None else None)
        for number, message in enumerate(self._playback.timed(), start=1):
            timing.wait_until(message.log_time)
            self._publish(message)
            progress.show(number, (message.log_time - start) * 1e-9)

    def _publish(self, message: BagMessage) -> None:
        topic = self._topics.get(message.topic)
        if topic is not None:
            topic.publish(message.data)

    def wait_for_delivery(self) -> None:
        """Let reliable subscribers get the last messages before the publishers go."""
        for topic in self._topics.values():
            topic.wait_for_all_acked(Duration(seconds=DELIVERY))

    def _tick(self, now: int) -> None:
        clock = Clock()
        clock.clock.sec, clock.clock.nanosec = divmod(now, 1_000_000_000)
        if self._clock is not None:
            self._clock.publish(clock)


class Played:
    """A line on a terminal that says how far it is; nothing elsewhere."""

    def __init__(self, messages: int, seconds: float) -> None:
        self._total = f'{messages} messages, {seconds:.1f} s'
        self._shown = 0.0
        self._on_terminal = sys.stderr.isatty()

    def show(self, number: int, seconds: float) -> None:
        """Say that `number` messages of `seconds` s are played, at most ten times a second."""
        if self._on_terminal and time.monotonic() - self._shown > 0.1:
            self._shown = time.monotonic()
            print(f'\r{number}, {seconds:.1f} s of {self._total} ', end='', file=sys.stderr)

    def end(self) -> None:
        """Leave the line."""
        if self._on_terminal and self._shown:
            print(file=sys.stderr)


def _message_class(name: str) -> Any | None:
    """The class of a message type, None where it is not installed.

    Only packages with interfaces are imported: the name comes from a file.
    """
    parts = re.fullmatch(r'([a-z]\w*)/msg/([A-Z]\w*)', name, re.ASCII)
    if parts is None or not has_resource('rosidl_interfaces', parts[1]):
        return None
    return getattr(importlib.import_module(f'{parts[1]}.msg'), parts[2], None)


def _profile(offered: OfferedQos) -> QoSProfile:
    return QoSProfile(
        depth=offered.depth,
        reliability=(
            ReliabilityPolicy.RELIABLE if offered.reliable else ReliabilityPolicy.BEST_EFFORT
        ),
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if offered.latched else DurabilityPolicy.VOLATILE
        ),
    )


def main() -> int:
    """The command."""
    return run_command(_replay)


def _replay() -> None:
    parser = CommandParser('replay', ABOUT, EXAMPLE)
    parser.add_argument('bag', metavar='BAG', type=Path, help="a bag's folder or .mcap file")
    parser.add_argument(
        '--rate', type=number_from(1e-3, 1e9), default=1.0, help='times as fast as recorded'
    )
    parser.add_argument('--loop', action='store_true', help='from the start again, until Ctrl-C')
    parser.add_argument('--clock', action='store_true', help="publish the bag's time on /clock")
    parser.add_argument(
        '--wait',
        type=number_from(0, 3600),
        default=2.0,
        metavar='S',
        help='longest time to wait for subscribers before playing (default: %(default)s)',
    )
    refuse_other_encodings(sys.argv)
    try:
        given = parser.parse_args(remove_ros_args(sys.argv)[1:])
    except RuntimeError as error:  # what rcl raises for arguments that it cannot parse
        raise ParameterError(str(error).partition(', at ')[0]) from error
    pace = Pace(Progress(sys.stderr), f'looking through {given.bag}', 'MB', 1e6)
    playback = read_playback(given.bag, pace)
    pace.end()
    # Ctrl-C is ours: it shall not take the graph away in the middle of a message
    init(sys.argv)
    node = ReplayNode(playback, given.clock)
    warn_of_unknown(node)
    first, last = playback.span
    progress = Played(len(playback), (last - first) * 1e-9)
    try:
        if not node.playable:
            raise BagError(f'{given.bag}: no topic of a type that is installed here')
        count = node.wait_for_subscribers(given.wait)
        node.get_logger().info(f'playing {len(playback)} messages to {count} subscribers')
        node.play(given.rate, progress)
        while given.loop:
            node.play(given.rate, progress)
        node.wait_for_delivery()
    finally:
        progress.end()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    sys.exit(main())
