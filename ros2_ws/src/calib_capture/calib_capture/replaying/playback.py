# SPDX-License-Identifier: Apache-2.0
"""What to play back from a bag, in which order and when."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from calib_model.bags import BagMessage, read_messages
from calib_model.errors import BagError, DescriptionError
from calib_model.files import load_plain
from calib_model.topics import TRAJECTORY

CLOCK_PERIOD = 0.01  # s of wall time between two messages on /clock


@dataclass(frozen=True)
class OfferedQos:
    """The QoS that a recorded topic was offered with."""

    depth: int = 100
    reliable: bool = True
    latched: bool = False


@lru_cache  # each message brings its topic's text
def offered_qos(text: str) -> OfferedQos:
    """From rosbag2's `offered_qos_profiles` (YAML, words or older numbers); of several, the first.

    Text that says nothing usable gives the default, which every volatile subscriber can take.
    """
    try:
        profiles = load_plain(text, 'offered QoS')
    except DescriptionError:
        return OfferedQos()
    first: dict[str, Any] = {}
    if isinstance(profiles, list) and profiles and isinstance(profiles[0], dict):
        first = profiles[0]
    depth = first.get('depth')
    return OfferedQos(
        depth=depth if isinstance(depth, int) and 0 < depth <= 10_000 else OfferedQos.depth,
        reliable=first.get('reliability') not in ('best_effort', 2),
        latched=first.get('durability') in ('transient_local', 1),
    )


@dataclass(frozen=True)
class Playback:
    """The messages of a bag: the first of each latched topic, then all others in log-time order.

    `commands` are topics that are left out: an arm would move by them.
    """

    latched: list[BagMessage]
    timed: list[BagMessage]
    commands: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.latched) + len(self.timed)

    @property
    def span(self) -> tuple[int, int]:
        """First and last log time, ns."""
        times = [message.log_time for message in (*self.latched, *self.timed)]
        return min(times), max(times)


def read_playback(path: Path) -> Playback:
    """What to play of the bag at `path`.

    Raises:
        BagError: no bag there, damaged, or it holds no messages to play.
    """
    recorded = sorted(read_messages(path), key=lambda message: message.log_time)
    commands = tuple(sorted({each.topic for each in recorded if each.type == TRAJECTORY}))
    messages = [message for message in recorded if message.topic not in commands]
    if not messages:
        raise BagError(f'{path}: the bag holds no messages' + ' but commands' * bool(commands))
    first: dict[str, BagMessage] = {}
    for message in messages:
        if offered_qos(message.offered_qos).latched:
            first.setdefault(message.topic, message)
    leading = {id(message) for message in first.values()}
    timed = [message for message in messages if id(message) not in leading]
    return Playback(list(first.values()), timed, commands)


class Timing:
    """The bag's time as it passes: `rate` seconds of it in every second of the wall's.

    `tick`, when given, is called with the bag's time in ns every `CLOCK_PERIOD` of wall time.
    """

    def __init__(self, start: int, rate: float, tick: Callable[[int], None] | None = None) -> None:
        self._start, self._rate, self._tick = start, rate, tick
        self._begun = self._next_tick = time.monotonic()

    def now(self) -> int:
        """The bag's time, ns."""
        return self._start + int((time.monotonic() - self._begun) * self._rate * 1e9)

    def wait_until(self, log_time: int) -> None:
        """Sleep until the bag's time is `log_time` (ns), ticking meanwhile."""
        due = self._begun + (log_time - self._start) / self._rate / 1e9
        while True:
            wall = time.monotonic()
            if self._tick is not None and wall >= self._next_tick:
                self._tick(self.now())
                self._next_tick = max(self._next_tick + CLOCK_PERIOD, wall)
            if wall >= due:
                return
            until = due if self._tick is None else min(due, self._next_tick)
            time.sleep(max(0.0, until - wall))
