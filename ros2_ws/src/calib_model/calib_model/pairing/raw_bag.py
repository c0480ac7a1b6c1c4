# SPDX-License-Identifier: Apache-2.0
"""The raw streams of a bag, joint states and probe readings, read by columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib_model.bags import BagDescriptions, PoseMessages, Told, listed_topics, read_messages
from calib_model.errors import BagError
from calib_model.measurement import ProbingSet
from calib_model.pairing.readings import LARGEST
from calib_model.pairing.stream_columns import (
    JointBlock,
    ReadingBlock,
    joint_blocks,
    little_endian,
    reading_blocks,
)
from calib_model.pairing.stream_order import STEP_BACK, Rows
from calib_model.pairing.streams import RawStreams, RecordedStreams
from calib_model.stamps import SECOND
from calib_model.topics import (
    DESCRIPTIONS,
    DISPLACEMENTS,
    JOINT_STATE,
    POSE_TOPICS,
    RawTopics,
)

BLOCK = 20_000  # messages that are decoded together
MOST_SHOWN = 20  # names in an error
NO_STATUS = np.zeros((0, 3), dtype=np.uint8)


@dataclass
class RawBag:
    """A bag's raw streams as they were recorded, what they are described by, and recorded `poses`
    where they were asked for."""

    path: Path
    topics: RawTopics
    described: BagDescriptions
    poses: ProbingSet | None = None
    _joints: list[JointBlock] = field(default_factory=list)
    _readings: list[ReadingBlock] = field(default_factory=list)

    def recorded(self, names: Sequence[str]) -> RecordedStreams:
        """The streams as they were received, with the joints of these names, in this order; joint
        states that lack one of them, or have no number for it, are left out."""
        chosen = [block for block in self._joints if set(names) <= set(block.names)]
        columns = [[block.names.index(name) for name in names] for block in chosen]
        q = _joined(
            [block.position[:, order] for block, order in zip(chosen, columns, strict=True)],
            np.zeros((0, len(names))),
        )
        number, stamp = _joined([b.rows for b in chosen]), _joined([b.stamp for b in chosen])
        states = np.argsort(number)
        states = states[(np.abs(q[states]) <= LARGEST).all(axis=1)]
        read = _joined([block.displacement for block in self._readings], np.zeros((0, 3)))
        read_number = _joined([block.rows for block in self._readings])
        readings = np.argsort(read_number)
        sound = (np.abs(read) <= LARGEST).all(axis=1)
        return RecordedStreams(
            number[states],
            stamp[states],
            q[states],
            read_number[readings],
            _joined([block.stamp for block in self._readings])[readings],
            np.where(sound[:, None], read, np.nan)[readings],
            _joined([block.status for block in self._readings], NO_STATUS)[readings],
        )

    @property
    def has_readings(self) -> bool:
        """Whether there is any probe reading."""
        return bool(self._readings)

    def streams(self, names: Sequence[str], lateness: float = 0.0) -> RawStreams:
        """The streams in order, with the joints of these names, in this order; no readings where
        the bag has none.

        Raises:
            BagError: no joint state has them all, or the streams cannot belong together.
        """
        if not any(set(names) <= set(block.names) for block in self._joints):
            self._refuse_names(names)
        recorded = self.recorded(names)
        self._refuse_stamps(recorded.joint_stamp, self.topics.joint_states)
        if self.has_readings:
            self._refuse_stamps(recorded.reading_stamp, self.topics.displacements)
        found = recorded.ordered(lateness)
        if self.has_readings:
            self._refuse_apart(found)
        return found

    def refuse_missing(self, readings: bool = True) -> None:
        """Refuse it where it lacks one of the streams.

        Raises:
            BagError: names the topic, and those of its type that the bag has.
        """
        every = {each.topic: each.type for each in read_messages(self.path)}
        refuse_topics(self.path, self.topics, every or {'': ''}, readings)

    def _refuse_stamps(self, stamp: Rows, topic: str) -> None:
        if not len(stamp):
            raise BagError(f"{self.path}: {topic} has no message with all of the arm's joints")
        if not stamp.any():
            raise BagError(f'{self.path}: {topic} has no stamps, they are all 0')
        back = np.maximum.accumulate(stamp) - stamp
        if back.max() > STEP_BACK:
            raise BagError(
                f'{self.path}: the stamps of {topic} fall back by {back.max() / SECOND:.3g} s, '
                'as if the arm had been started anew: record what comes after in a bag of its own'
            )

    def _refuse_names(self, names: Sequence[str]) -> None:
        seen = list(dict.fromkeys(name for block in self._joints for name in block.names))
        missing = [name for name in names if name not in seen]
        if not missing:
            raise BagError(
                f'{self.path}: no message on {self.topics.joint_states} has all of the joints '
                f'{", ".join(names)}'
            )
        some = ', '.join(seen[:MOST_SHOWN]) + (', ...' if len(seen) > MOST_SHOWN else '')
        raise BagError(
            f'{self.path}: {self.topics.joint_states} has no joint {missing[0]} (it has '
            f"{some}): say which are the arm's, base first, with --joints"
        )

    def _refuse_apart(self, found: RawStreams) -> None:
        first, last = found.joint_stamp[[0, -1]]
        inside = (found.reading_stamp >= first) & (found.reading_stamp <= last)
        if not inside.any():
            away = (found.reading_stamp[0] - first) / SECOND
            raise BagError(
                f'{self.path}: no reading falls between the joint states, the first is '
                f'{away:+.6g} s from theirs: two clocks?'
            )


def _joined(parts: Sequence[np.ndarray], none: np.ndarray | None = None) -> Any:
    return np.concatenate(parts) if parts else np.zeros(0, np.int64) if none is None else none


class _Block:
    """Messages of one topic on their way to arrays."""

    def __init__(
        self,
        path: Path,
        topic: str,
        kind: str,
        decode: Callable[[Sequence[bytes]], Iterator[Any]],
        into: list[Any],
    ) -> None:
        self.path, self.topic, self.kind = path, topic, kind
        self._decode, self._into = decode, into
        self._waiting: list[bytes] = []
        self._numbers: list[int] = []
        self.count = 0

    def add(self, data: bytes, number: int) -> None:
        self.count += 1
        self._waiting.append(data)
        self._numbers.append(number)
        if len(self._waiting) >= BLOCK:
            self.decode()

    def decode(self) -> None:
        waiting, self._waiting = self._waiting, []
        numbers, self._numbers = np.array(self._numbers, dtype=np.int64), []
        try:
            messages = [little_endian(self.kind, data) for data in waiting]
            self._into += [
                replace(block, rows=numbers[block.rows]) for block in self._decode(messages)
            ]
        except ValueError as error:
            raise BagError(f'{self.path}: {self.topic}: {error}') from error


def read_raw(
    path: str | Path,
    topics: RawTopics,
    told: Told | None = None,
    with_poses: bool = False,
    readings: bool = True,
) -> RawBag:
    """The raw streams of a bag and what descriptions it has; `with_poses` its poses as well. Not
    `readings`: it may be without any, as of a passive probe.

    Raises:
        BagError: no bag, a topic missing or of another type, or a message that cannot be read.
    """
    path = Path(path)
    refuse_topics(path, topics, listed_topics(path), readings)
    bag = RawBag(path, topics, BagDescriptions(path))
    blocks = {
        topics.joint_states: _Block(
            path, topics.joint_states, JOINT_STATE, joint_blocks, bag._joints
        ),
        topics.displacements: _Block(
            path, topics.displacements, DISPLACEMENTS, reading_blocks, bag._readings
        ),
    }
    poses = PoseMessages(path)
    wanted = {*blocks, *(topic.name for topic in DESCRIPTIONS)}
    pose_topics = {topic.name for topic in POSE_TOPICS}
    wanted |= pose_topics if with_poses else set()
    for number, message in enumerate(read_messages(path, wanted, told=told)):
        block = blocks.get(message.topic)
        if block is None:
            (poses if message.topic in pose_topics else bag.described).take(message)
            continue
        if message.type != block.kind:
            raise BagError(
                f'{path}: topic {message.topic} has type {message.type}, not {block.kind}'
            )
        block.add(message.data, number)
    for block in blocks.values():
        block.decode()
    if not all(block.count for block in blocks.values()):
        bag.refuse_missing(readings)
    bag.poses = poses.read()
    return bag


def refuse_topics(
    path: Path, topics: RawTopics, there: Mapping[str, str], readings: bool = True
) -> None:
    """Refuse a bag with these topics and types that lacks one of the streams; none: not known. Not
    `readings`: these may be missing, but not be on another topic.

    Raises:
        BagError: names the topic, and those of its type that the bag has.
    """
    for topic, kind, option in (
        (topics.joint_states, JOINT_STATE, 'joint-states'),
        (topics.displacements, DISPLACEMENTS, 'displacements'),
    ):
        if not there or topic in there:
            continue
        others = sorted(name for name, its in there.items() if its == kind)
        if not others and kind == DISPLACEMENTS and not readings:
            continue
        if not others:
            raise BagError(f'{path}: no messages on {topic}, nor any other {kind}')
        raise BagError(
            f'{path}: no messages on {topic}, but on {", ".join(others)}: say which with --{option}'
        )
