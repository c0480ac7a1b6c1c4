# SPDX-License-Identifier: Apache-2.0
"""Recordings of joint states and readings that no sound arm and probe would give."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from calib_model.arrays import Array
from calib_model.bags import BagWriter, cdr, read_messages
from calib_model.topics import (
    CAPTURE_POSES,
    DESCRIPTIONS,
    DISPLACEMENTS,
    JOINT_STATE,
    JOINT_STATES,
    PROBE_DISPLACEMENTS,
)

NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 1e17, 1e5, 1e-320, 0.0, 3.15, -7.0)
STAMPS = (0, 1, -1, 2**31 * 10**9 - 1, 2**62, 10**9, -(10**18), 2**32 * 10**9)
SHIFTS = (10**6, 10**8, 10**9, 10**12, -(10**9), 2**62, -(10**18))
KNOWN = {topic.name: topic for topic in (*DESCRIPTIONS, CAPTURE_POSES)}


@dataclass
class State:
    """A joint state."""

    stamp: int
    names: list[str]
    position: Array


@dataclass
class Read:
    """A probe reading."""

    stamp: int
    displacement: Array
    status: list[int]


@dataclass
class Streams:
    """Both streams, and the other messages of the bag as they are; `given` keeps their order."""

    states: list[State]
    readings: list[Read]
    others: list[tuple[str, bytes, int]]
    given: bool = False


@cache
def recorded(path: Path) -> tuple[tuple[str, int, bytes], ...]:
    """Topic, log time and content of all messages."""
    return tuple((each.topic, each.log_time, each.data) for each in read_messages(path))


def _read(path: Path) -> Streams:
    found = Streams([], [], [])
    for topic, time, data in recorded(path):
        if topic == JOINT_STATES.name:
            state = cdr.decode(JOINT_STATE, data)
            position = np.array(state.position)
            found.states.append(State(cdr.stamp_of(state), list(state.name), position))
        elif topic == PROBE_DISPLACEMENTS.name:
            reading = cdr.decode(DISPLACEMENTS, data)
            found.readings.append(
                Read(
                    cdr.stamp_of(reading),
                    np.array(reading.displacement),
                    [int(status) for status in reading.status],
                )
            )
        else:
            found.others.append((topic, data, time))
    return found


def _some(items: list[Any], rng: random.Random) -> list[Any]:
    share = rng.choice((0.01, 0.2, 1.0))
    return [item for item in items if rng.random() < share]


def _backwards(streams: Streams, rng: random.Random) -> None:
    rng.choice((streams.states, streams.readings)).reverse()
    streams.given = True


def _shuffled(streams: Streams, rng: random.Random) -> None:
    rng.shuffle(streams.states)
    rng.shuffle(streams.readings)
    streams.given = True


def _equal_stamps(streams: Streams, rng: random.Random) -> None:
    stamp = rng.choice((*STAMPS, streams.states[0].stamp if streams.states else 0))
    for each in _some(rng.choice((streams.states, streams.readings)), rng):
        each.stamp = stamp


def _odd_stamps(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.states + streams.readings, rng):
        each.stamp = rng.choice(STAMPS)


def _shifted(streams: Streams, rng: random.Random) -> None:
    shift = rng.choice(SHIFTS)
    for each in streams.readings:
        each.stamp += shift


def _other_order(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.states, rng):
        order = rng.sample(range(len(each.names)), len(each.names))
        each.names = [each.names[i] for i in order]
        if len(each.position) == len(order):
            each.position = each.position[order]


def _missing(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.states, rng):
        at = rng.randrange(6)
        each.names, each.position = each.names[:at], each.position[: rng.choice((at, 0, 6))]


def _extra(streams: Streams, rng: random.Random) -> None:
    more = rng.choice((1, 50, 900, 1200))
    for each in _some(streams.states, rng):
        each.names = [*each.names, *(f'more_{i}' for i in range(more))]
        each.position = np.concatenate([each.position, np.zeros(more)])


def _same_name(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.states, rng):
        each.names = each.names[:1] * len(each.names)


def _odd_numbers(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.states, rng):
        if len(each.position):
            each.position[rng.randrange(len(each.position))] = rng.choice(NUMBERS)
    for each in _some(streams.readings, rng):
        each.displacement[rng.randrange(3)] = rng.choice(NUMBERS)


def _status(streams: Streams, rng: random.Random) -> None:
    for each in _some(streams.readings, rng):
        each.status[rng.randrange(3)] = rng.choice((1, 2, 3, 4, 255))


def _constant(streams: Streams, rng: random.Random) -> None:
    if rng.random() < 0.5:
        for state in streams.states:
            state.position = streams.states[0].position.copy()
    else:
        for reading in streams.readings:
            reading.displacement = streams.readings[0].displacement.copy()


def _one_topic(streams: Streams, rng: random.Random) -> None:
    kept = rng.randrange(2)
    rng.choice((streams.states, streams.readings))[kept:] = []


def _undescribed(streams: Streams, rng: random.Random) -> None:
    topic = rng.choice(list(KNOWN))
    streams.others = [each for each in streams.others if each[0] != topic]


def _gaps(streams: Streams, rng: random.Random) -> None:
    width = rng.choice((3, 7, 30))
    streams.states = [each for i, each in enumerate(streams.states) if i // width % 2]


def _two_sources(streams: Streams, rng: random.Random) -> None:
    streams.states += [
        State(each.stamp + 1000, each.names, each.position + 0.5) for each in streams.states
    ]


def _played_twice(streams: Streams, rng: random.Random) -> None:
    streams.states += [State(e.stamp, e.names, e.position) for e in streams.states]
    streams.readings += [Read(e.stamp, e.displacement, e.status) for e in streams.readings]
    streams.given = True


def _other_units(streams: Streams, rng: random.Random) -> None:
    with np.errstate(all='ignore'):
        for state in streams.states:
            state.position = np.degrees(state.position)
        for reading in streams.readings:
            reading.displacement = reading.displacement * rng.choice((1.0, 1e3))


DISORDERS: dict[str, Callable[[Streams, random.Random], None]] = {
    'backwards': _backwards,
    'shuffled': _shuffled,
    'equal stamps': _equal_stamps,
    'odd stamps': _odd_stamps,
    'another clock': _shifted,
    'joints in another order': _other_order,
    'joints missing': _missing,
    'more joints': _extra,
    'one name': _same_name,
    'odd numbers': _odd_numbers,
    'not in contact': _status,
    'constant': _constant,
    'a topic missing': _one_topic,
    'a description or the poses missing': _undescribed,
    'gaps': _gaps,
    'two sources': _two_sources,
    'played twice': _played_twice,
    'other units': _other_units,
}


def disordered(source: Path, path: Path, rng: random.Random, kinds: Sequence[str]) -> None:
    """A bag of the first minutes of another one, with these disorders."""
    streams = _read(source)
    streams.states = streams.states[: rng.choice((20, 200, len(streams.states)))]
    last = streams.states[-1].stamp
    streams.readings = [each for each in streams.readings if each.stamp <= last]
    for kind in kinds:
        DISORDERS[kind](streams, rng)
    messages: list[State | Read] = [*streams.states, *streams.readings]
    if not streams.given:
        messages.sort(key=lambda each: each.stamp)
    with BagWriter(path, chunk_size=1 << 20) as bag:
        for topic, data, time in streams.others:
            bag.write(KNOWN[topic], data, time, time)
        for number, each in enumerate(messages):
            time = 10**9 + number * 10**6 if streams.given else min(max(0, each.stamp), 2**63 - 1)
            topic, message = _message(each)
            bag.write(topic, cdr.encode(message), time, time)


def _message(each: State | Read) -> tuple[Any, Any]:
    # seconds are 32 bits with a sign in a stamp
    stamp = min(max(each.stamp, -(2**31) * 10**9), 2**31 * 10**9 - 1)
    if isinstance(each, State):
        return JOINT_STATES, cdr.joint_state(stamp, '', each.names, each.position)
    status = np.array(each.status)
    return PROBE_DISPLACEMENTS, cdr.displacements(stamp, 'p', each.displacement, status)
