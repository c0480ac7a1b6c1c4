# SPDX-License-Identifier: Apache-2.0
"""What to play back from a bag, in which order and when."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.bags import BagMessage, Told, read_messages
from calib_model.errors import BagError, DescriptionError
from calib_model.files import load_plain
from calib_model.topics import TRAJECTORY

Rows = NDArray[np.int64]
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
    """The messages of a bag: `latched`, the first of each latched topic, then all others in the
    order of their log times, read as they are played: a bag may be larger than the memory.

    `topics` has a message of each topic, `span` (2,) the first and the last log time, ns.
    `commands` are topics that are left out: an arm would move by them.
    """

    path: Path
    topics: tuple[BagMessage, ...]
    latched: tuple[BagMessage, ...]
    span: tuple[int, int]
    commands: tuple[str, ...]
    _leading: frozenset[int]  # places of the latched ones among all that are played
    _turns: Rows  # places of the others among themselves, in the order of their log times

    def __len__(self) -> int:
        return len(self.latched) + len(self._turns)

    def timed(self) -> Iterator[BagMessage]:
        """The others; what comes before its turn waits for it, of a recording a few.

        Raises:
            BagError: the bag has changed since it was looked at.
        """
        early: dict[int, BagMessage] = {}
        coming = enumerate(self._others())
        for turn in self._turns.tolist():
            while turn not in early:
                place, message = next(coming, (turn, None))
                if message is None:
                    raise BagError(f'{self.path}: the bag has become shorter meanwhile')
                early[place] = message
            yield early.pop(turn)

    def _others(self) -> Iterator[BagMessage]:
        played = (each for each in read_messages(self.path) if each.topic not in self.commands)
        return (each for place, each in enumerate(played) if place not in self._leading)


def read_playback(path: Path, told: Told | None = None) -> Playback:
    """What to play of the bag at `path`; `told` hears how far it is.

    Raises:
        BagError: no bag there, damaged, or it holds no messages to play.
    """
    topics: dict[str, BagMessage] = {}
    numbers: dict[str, int] = {}
    first: dict[str, tuple[int, BagMessage]] = {}  # of latched topics, and which of all it is
    commands: set[str] = set()
    times, kinds = array('q'), array('i')
    for place, message in enumerate(read_messages(path, told=told)):
        topic = message.topic
        if topic not in topics:
            topics[topic], numbers[topic] = message, len(numbers)
        if message.type == TRAJECTORY:
            commands.add(topic)
        times.append(message.log_time)
        kinds.append(numbers[topic])
        if offered_qos(message.offered_qos).latched and (
            topic not in first or message.log_time < first[topic][1].log_time
        ):
            first[topic] = place, message
    left_out = [numbers[topic] for topic in commands]
    played = ~np.isin(np.array(kinds, dtype=np.int32), left_out)
    if not played.any():
        raise BagError(f'{path}: the bag holds no messages' + ' but commands' * bool(commands))
    leading = {topic: found for topic, found in first.items() if topic not in commands}
    stamps, among = np.array(times, dtype=np.int64)[played], np.cumsum(played) - 1
    places = [int(among[place]) for place, _ in leading.values()]
    return Playback(
        path,
        tuple(message for topic, message in topics.items() if topic not in commands),
        tuple(message for _, message in leading.values()),
        (int(stamps.min()), int(stamps.max())),
        tuple(sorted(commands)),
        frozenset(places),
        np.argsort(np.delete(stamps, places), kind='stable'),
    )


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
