# SPDX-License-Identifier: Apache-2.0
"""The raw streams of a bag, joint states and probe readings, read by columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.bags import BagDescriptions, PoseMessages, Told, listed_topics, read_messages
from calib_model.errors import BagError
from calib_model.measurement import ProbingSet
from calib_model.pairing.readings import LARGEST
from calib_model.pairing.stream_columns import (
    JointBlock,
    MessageBlocks,
    ReadingBlock,
    joined,
    joint_blocks,
    reading_blocks,
)
from calib_model.pairing.streams import RawStreams, RecordedStreams, Rows
from calib_model.stamps import SECOND
from calib_model.streams import Part, put_together, tell_no_time
from calib_model.topics import (
    DESCRIPTIONS,
    DISPLACEMENTS,
    JOINT_STATE,
    POSE_TOPICS,
    RawTopics,
)

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
    lines: list[str] = field(default_factory=list)  # what was made of them
    _joints: list[JointBlock] = field(default_factory=list)
    _readings: list[ReadingBlock] = field(default_factory=list)

    def recorded(self, names: Sequence[str]) -> RecordedStreams:
        """The streams as they were received, with the joints of these names, in this order; joint
        states that lack one of them, or have no number for it, are left out, and joints that come
        in several messages are put together.

        Raises:
            BagError: no joint state has them all, or a stream's stamps are all 0.
        """
        part = self._whole(names) or self._spread(names)
        states = _rows(part.number, _usable(part.joints))
        read = joined([block.displacement for block in self._readings], np.zeros((0, 3)))
        number = joined([block.rows for block in self._readings])
        usable = _usable(read)
        if not usable.all():
            read = np.where(usable[:, None], read, np.nan)
        readings = _rows(number, np.ones(len(number), dtype=np.bool_))
        recorded = RecordedStreams(
            part.number[states],
            part.stamp[states],
            part.joints[states],
            number[readings],
            joined([block.stamp for block in self._readings])[readings],
            read[readings],
            joined([block.status for block in self._readings], NO_STATUS)[readings],
        )
        self._refuse_stamps(recorded.joint_stamp, self.topics.joint_states)
        if self.has_readings:
            self._refuse_stamps(recorded.reading_stamp, self.topics.displacements)
        return recorded

    def _whole(self, names: Sequence[str]) -> Part | None:
        """The joint states that have all of the joints; None: there are none."""
        chosen = [block for block in self._joints if set(names) <= set(block.names)]
        return _part(chosen, names, range(len(names))) if chosen else None

    def _spread(self, names: Sequence[str]) -> Part:
        """Joint states of which each has some of the joints."""
        groups: dict[tuple[int, ...], list[int]] = {}
        for column, name in enumerate(names):
            having = (row for row, block in enumerate(self._joints) if name in block.names)
            groups.setdefault(tuple(having), []).append(column)
        if () in groups:
            self._refuse_names(names)
        together = put_together(
            [
                _part([self._joints[row] for row in rows], [names[c] for c in columns], columns)
                for rows, columns in groups.items()
            ]
        )
        texts = [' '.join(names[column] for column in columns) for columns in groups.values()]
        self.lines.append(
            f'{self.topics.joint_states}: joints come in several messages ({"; ".join(texts)}), '
            f'put together by their stamps: {len(together.stamp)} joint states'
        )
        return together

    @property
    def has_readings(self) -> bool:
        """Whether there is any probe reading."""
        return bool(self._readings)

    def streams(self, names: Sequence[str], lateness: float = 0.0) -> list[RawStreams]:
        """The streams in order, with the joints of these names, in this order; no readings where
        the bag has none. In several parts where a clock was set back.

        Raises:
            BagError: no joint state has them all, or the streams cannot belong together.
        """
        recorded = self.recorded(names)
        parts = [part.ordered(lateness) for part in recorded.stretches()]
        used = [part for part in parts if _together(part) or not self.has_readings]
        if not used:
            self._refuse_apart(max(parts, key=lambda part: len(part.joints)))
        if len(parts) > 1:
            self.lines.append(self._stepped_back(recorded, len(used)))
        return used

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

    def _stepped_back(self, recorded: RecordedStreams, used: int) -> str:
        back = max(
            int((np.maximum.accumulate(stamp) - stamp).max(initial=0))
            for stamp in (recorded.joint_stamp, recorded.reading_stamp)
        )
        return (
            f'warning: {self.path}: the clock is set back, by {back / SECOND:.3g} s at most: read '
            f'as {used} recordings, one after the other'
        )

    def by_recording(self, how: str) -> None:
        """Let all messages count by when they were recorded, where `how` is `record`, or `auto` and
        their own stamps tell no time."""
        if how == 'header':
            return
        if how == 'auto':
            why = _no_time(self.topics.joint_states, self._joints)
            why = why or _no_time(self.topics.displacements, self._readings)
            if not why:
                return
            self.lines.append(
                f'warning: {self.path}: {why}: both topics go by when they were recorded '
                '(--stamps record)'
            )
        self._joints = [replace(block, stamp=block.logged) for block in self._joints]
        self._readings = [replace(block, stamp=block.logged) for block in self._readings]

    def _forget_recorded(self) -> None:
        """Let go of when messages were recorded, once that has been asked."""
        nothing = np.zeros(0, dtype=np.int64)
        self._joints = [replace(block, logged=nothing) for block in self._joints]
        self._readings = [replace(block, logged=nothing) for block in self._readings]

    def _refuse_names(self, names: Sequence[str]) -> NoReturn:
        seen = list(dict.fromkeys(name for block in self._joints for name in block.names))
        missing = [name for name in names if name not in seen]
        some = ', '.join(seen[:MOST_SHOWN]) + (', ...' if len(seen) > MOST_SHOWN else '')
        raise BagError(
            f'{self.path}: {self.topics.joint_states} has no joint {missing[0]} (it has '
            f"{some}): say which are the arm's, base first, with --joints"
        )

    def _refuse_apart(self, found: RawStreams) -> NoReturn:
        if not len(found.reading_stamp):
            raise BagError(f'{self.path}: no reading while there are joint states')
        away = (found.reading_stamp[0] - found.joint_stamp[0]) / SECOND
        raise BagError(
            f'{self.path}: no reading falls between the joint states, the first is '
            f'{away:+.6g} s from theirs: two clocks? (--stamps record goes by one)'
        )


def _usable(values: Array) -> NDArray[np.bool_]:
    """Which rows (N, k) hold numbers alone that a sensor may give."""
    usable = np.ones(len(values), dtype=np.bool_)
    for column in values.T:
        usable &= (column <= LARGEST) & (column >= -LARGEST)
    return usable


def _rows(number: Rows, kept: NDArray[np.bool_]) -> Rows | slice:
    """Those that are kept, in the order of their numbers; all of them as they are is no copy, of
    what may be hundreds of MB."""
    if kept.all() and (np.diff(number) > 0).all():
        return slice(None)
    rows = np.argsort(number, kind='stable')
    return rows[kept[rows]]


def _part(blocks: Sequence[JointBlock], names: Sequence[str], columns: Sequence[int]) -> Part:
    return Part(
        tuple(columns),
        joined([block.rows for block in blocks]),
        joined([block.stamp for block in blocks]),
        joined([_of(block, names) for block in blocks]),
    )


def _of(block: JointBlock, names: Sequence[str]) -> Array:
    """The joints of these names, in this order."""
    if tuple(names) == block.names:
        return block.position
    return block.position[:, [block.names.index(name) for name in names]]


def _together(part: RawStreams) -> bool:
    """Whether a reading falls between the joint states."""
    if not len(part.joint_stamp):
        return False
    first, last = part.joint_stamp[[0, -1]]
    return bool(((part.reading_stamp >= first) & (part.reading_stamp <= last)).any())


def _no_time(topic: str, blocks: Sequence[Any]) -> str:
    """Why the stamps of a topic tell no time, in words; '' where they do."""
    if not blocks:
        return ''
    # of several kinds, the usual one
    most = max(blocks, key=lambda block: len(block.rows))
    content = most.position if isinstance(most, JointBlock) else most.displacement
    why = tell_no_time(most.stamp, most.logged, content)
    return f'the stamps in the headers of {topic} {why}' if why else ''


def read_raw(
    path: str | Path,
    topics: RawTopics,
    told: Told | None = None,
    with_poses: bool = False,
    readings: bool = True,
    stamps: str = 'auto',
) -> RawBag:
    """The raw streams of a bag and what descriptions it has; `with_poses` its poses as well. Not
    `readings`: it may be without any, as of a passive probe.

    `stamps` says which count: those in the messages' `header`, those of when they were recorded,
    `record`, or, `auto`, the latter where the former tell no time.

    Raises:
        BagError: no bag, a topic missing or of another type, or a message that cannot be read.
    """
    path = Path(path)
    refuse_topics(path, topics, listed_topics(path), readings)
    bag = RawBag(path, topics, BagDescriptions(path))
    blocks = {
        topics.joint_states: MessageBlocks(
            path, topics.joint_states, JOINT_STATE, joint_blocks, bag._joints
        ),
        topics.displacements: MessageBlocks(
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
        block.add(message.data, number, message.log_time)
    for block in blocks.values():
        block.finish()
    if not all(block.count for block in blocks.values()):
        bag.refuse_missing(readings)
    bag.poses = poses.read()
    bag.by_recording(stamps)
    bag._forget_recorded()
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
