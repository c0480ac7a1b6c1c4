# SPDX-License-Identifier: Apache-2.0
"""The two raw streams of a bag, joint states and probe readings, as arrays in time order."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.bags import BagDescriptions, Told, listed_topics, read_messages
from calib_model.errors import BagError
from calib_model.pairing.raw_topics import RawTopics
from calib_model.pairing.stop_and_go import LARGEST
from calib_model.pairing.stream_columns import (
    JointBlock,
    ReadingBlock,
    Rows,
    joint_blocks,
    little_endian,
    reading_blocks,
)
from calib_model.stamps import SECOND
from calib_model.topics import (
    DESCRIPTIONS,
    DISPLACEMENTS,
    JOINT_STATE,
)

BLOCK = 20_000  # messages that are decoded together
MOST_SHOWN = 20  # names in an error
STEP_BACK = 1.0  # s: stamps that fall back by more come from an arm that was started anew


@dataclass(frozen=True)
class RawStreams:
    """Joints (M, n) in rad at `joint_stamp` (M,), ns, displacements (N, 3) in m and the styli's
    `status` (N, 3) at `reading_stamp` (N,), NaN where one is no number; both in the
    stamps' order, no stamp twice.

    `left_out` counts joint states that lack a joint of the arm, `unordered` what came out of order.
    """

    joint_stamp: Rows
    joints: Array
    reading_stamp: Rows
    displacement: Array
    status: NDArray[np.uint8]
    left_out: int = 0
    unordered: int = 0

    @property
    def seconds(self) -> float:
        """From the first joint state to the last."""
        return float(self.joint_stamp[-1] - self.joint_stamp[0]) / SECOND


@dataclass
class RawBag:
    """A bag's raw streams as they were recorded, and what they are described by."""

    path: Path
    topics: RawTopics
    described: BagDescriptions
    _joints: list[JointBlock] = field(default_factory=list)
    _readings: list[ReadingBlock] = field(default_factory=list)

    def streams(self, names: Sequence[str]) -> RawStreams:
        """The streams with the joints of these names, in this order.

        Raises:
            BagError: no joint state has them all, or the streams cannot belong together.
        """
        chosen = [block for block in self._joints if set(names) <= set(block.names)]
        if not chosen:
            self._refuse_names(names)
        columns = [[block.names.index(name) for name in names] for block in chosen]
        q = np.concatenate(
            [block.position[:, order] for block, order in zip(chosen, columns, strict=True)]
        )
        stamp = np.concatenate([block.stamp for block in chosen])
        finite = (np.abs(q) <= LARGEST).all(axis=1)
        everything = sum(len(block.rows) for block in self._joints)
        joint_stamp, order = self._ordered(stamp[finite], self.topics.joint_states)
        read_stamp, read_order = self._ordered(
            np.concatenate([block.stamp for block in self._readings]), self.topics.displacements
        )
        unordered = finite.sum() - len(order) + sum(len(b.rows) for b in self._readings)
        readings = np.concatenate([block.displacement for block in self._readings])[read_order]
        number = (np.abs(readings) <= LARGEST).all(axis=1)
        found = RawStreams(
            joint_stamp,
            q[finite][order],
            read_stamp,
            np.where(number[:, None], readings, np.nan),
            np.concatenate([block.status for block in self._readings])[read_order],
            everything - int(finite.sum()),
            int(unordered) - len(read_order),
        )
        self._refuse_apart(found)
        return found

    def _ordered(self, stamp: Rows, topic: str) -> tuple[Rows, Rows]:
        """The stamps in order without those that come twice, and the rows they are in."""
        if not len(stamp):
            raise BagError(f"{self.path}: {topic} has no message with all of the arm's joints")
        if not stamp.any():
            raise BagError(f'{self.path}: {topic} has no stamps, they are all 0')
        back = np.maximum.accumulate(stamp) - stamp
        if back.max() > STEP_BACK * SECOND:
            raise BagError(
                f'{self.path}: the stamps of {topic} fall back by {back.max() / SECOND:.3g} s, '
                'as if the arm had been started anew: record what comes after in a bag of its own'
            )
        ordered, rows = np.unique(stamp, return_index=True)
        return ordered, rows

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


class _Block:
    """Messages of one topic on their way to arrays."""

    def __init__(
        self,
        path: Path,
        topic: str,
        kind: str,
        decode: Callable[[Sequence[bytes]], Any],
        into: list[Any],
    ) -> None:
        self.path, self.topic, self.kind = path, topic, kind
        self._decode, self._into = decode, into
        self._waiting: list[bytes] = []
        self.count = 0

    def add(self, data: bytes) -> None:
        self.count += 1
        self._waiting.append(data)
        if len(self._waiting) >= BLOCK:
            self.decode()

    def decode(self) -> None:
        waiting, self._waiting = self._waiting, []
        try:
            self._into += self._decode([little_endian(self.kind, data) for data in waiting])
        except ValueError as error:
            raise BagError(f'{self.path}: {self.topic}: {error}') from error


def read_raw(path: str | Path, topics: RawTopics, told: Told | None = None) -> RawBag:
    """The raw streams of a bag and what descriptions it has.

    Raises:
        BagError: no bag, a topic missing or of another type, or a message that cannot be read.
    """
    path = Path(path)
    refuse_topics(path, topics, listed_topics(path))
    bag = RawBag(path, topics, BagDescriptions(path))
    blocks = {
        topics.joint_states: _Block(
            path, topics.joint_states, JOINT_STATE, lambda m: list(joint_blocks(m)), bag._joints
        ),
        topics.displacements: _Block(
            path,
            topics.displacements,
            DISPLACEMENTS,
            lambda m: list(reading_blocks(m)),
            bag._readings,
        ),
    }
    wanted = {*blocks, *(topic.name for topic in DESCRIPTIONS)}
    for message in read_messages(path, wanted, told=told):
        block = blocks.get(message.topic)
        if block is None:
            bag.described.take(message)
            continue
        if message.type != block.kind:
            raise BagError(
                f'{path}: topic {message.topic} has type {message.type}, not {block.kind}'
            )
        block.add(message.data)
    for block in blocks.values():
        block.decode()
    if not all(block.count for block in blocks.values()):
        every = {each.topic: each.type for each in read_messages(path)}
        refuse_topics(path, topics, every or {'': ''})
    return bag


def refuse_topics(path: Path, topics: RawTopics, there: Mapping[str, str]) -> None:
    """Refuse a bag with these topics and types that lacks one of the streams; none: not known.

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
        if not others:
            raise BagError(f'{path}: no messages on {topic}, nor any other {kind}')
        raise BagError(
            f'{path}: no messages on {topic}, but on {", ".join(others)}: say which with --{option}'
        )
