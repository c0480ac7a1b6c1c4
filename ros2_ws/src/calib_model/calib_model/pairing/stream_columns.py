# SPDX-License-Identifier: Apache-2.0
"""Many JointState or StylusDisplacements messages at once: alike in layout, they are one table."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.bags import cdr
from calib_model.errors import BagError
from calib_model.pairing.streams import Rows
from calib_model.stamps import SECOND
from calib_model.topics import DISPLACEMENTS, JOINT_STATE

HEADER = 4  # bytes of the CDR header, from behind which alignment counts
STRINGS = 12  # offset of the frame's length, behind CDR header and stamp
MOST_NAMES = 1000  # joints of all the arms in one message
LONGEST_NAME = 1000  # bytes
MOST_LAYOUTS = 1000  # each is looked for in all messages
BLOCK = 20_000  # messages that are decoded together
#: so decoded, that become one: of many small arrays the allocator would keep the room
TOGETHER = 32
Bytes = NDArray[np.uint8]


def _no_rows() -> Rows:
    return np.zeros(0, dtype=np.int64)


@dataclass(frozen=True)
class JointBlock:
    """Joint states that name the same joints: `rows` (N,) of the messages they come from, `stamp`
    (N,) in ns, `position` (N, k) in rad, as many as `names`."""

    names: tuple[str, ...]
    rows: Rows
    stamp: Rows
    position: Array
    logged: Rows = field(default_factory=_no_rows)  # when they were recorded, ns


@dataclass(frozen=True)
class ReadingBlock:
    """Probe readings: `rows` (N,), `stamp` (N,) in ns, `displacement` (N, 3) in m, `status`."""

    rows: Rows
    stamp: Rows
    displacement: Array
    status: Bytes
    logged: Rows = field(default_factory=_no_rows)


def joint_blocks(messages: Sequence[bytes]) -> Iterator[JointBlock]:
    """The joint states in CDR messages, those of one layout together.

    Raises:
        ValueError: a message is no JointState.
    """
    for rows, table in _tables(messages, joint_layout):
        layout = joint_layout(table[0].tobytes())
        names = layout.names(table[0].tobytes())
        position = _column(table, layout.values, '<f8', layout.count)
        # some publish fewer positions than names, or none: of which joints, nobody knows
        names = names if layout.count >= len(names) else ()
        yield JointBlock(names, rows, _stamps(table), position[:, : len(names)])


def reading_blocks(messages: Sequence[bytes]) -> Iterator[ReadingBlock]:
    """The probe readings in CDR messages, those of one layout together.

    Raises:
        ValueError: a message is no StylusDisplacements.
    """
    for rows, table in _tables(messages, _reading_layout):
        values = _reading_layout(table[0].tobytes()).values
        status = table[:, values + 24 : values + 27].copy()  # else all of the messages stay
        yield ReadingBlock(rows, _stamps(table), _column(table, values, '<f8', 3), status)


@dataclass(frozen=True)
class Layout:
    """Where things are (bytes): `strings` with begin and length, `count` doubles at `values`.

    `fixed` are the places that must be equal for two messages of one length to be of one layout:
    byte order, lengths and names, but no padding, which holds whatever was in memory.
    """

    strings: tuple[tuple[int, int], ...]
    values: int
    count: int
    fixed: NDArray[np.int64]

    def names(self, data: bytes) -> tuple[str, ...]:
        """The joints that a joint state of this layout names; the first string is its frame."""
        return tuple(
            data[begin : begin + length - 1].decode('utf-8', 'replace')
            for begin, length in self.strings[1:]
        )


class _Reading:
    """Walks through a message and notes the places that place everything else."""

    def __init__(self, data: bytes, kind: str) -> None:
        self.data, self.kind = data, kind
        self.at = STRINGS
        self.fixed = [0, 1]
        if len(data) < STRINGS + 4 or data[0] != 0 or data[1] != 1:
            raise ValueError(f'not a {kind}: not little-endian CDR')

    def align(self, size: int) -> None:
        self.at += -(self.at - HEADER) % size

    def length(self, most: int = 1 << 32) -> int:
        self.align(4)
        if self.at + 4 > len(self.data):
            raise ValueError(f'not a {self.kind}: too short')
        (value,) = struct.unpack_from('<I', self.data, self.at)
        if value > most:
            raise ValueError(f'not a {self.kind}: a length of {value}, expected {most} at most')
        self.fixed += range(self.at, self.at + 4)
        self.at += 4
        return int(value)

    def string(self, counts: bool = True) -> tuple[int, int]:
        """Where a string is; `counts`: another text makes another layout."""
        length = self.length(LONGEST_NAME)
        begin = self.at
        self.room(length)
        if counts:
            self.fixed += range(begin, begin + length)
        self.at += length
        return begin, length

    def room(self, size: int) -> None:
        if self.at + size > len(self.data):
            raise ValueError(f'not a {self.kind}: too short')


def joint_layout(data: bytes) -> Layout:
    """Where things are in a JointState message, CDR and little-endian.

    Raises:
        ValueError: it is none, or has more joints or longer names than an arm.
    """
    found = _Reading(data, JOINT_STATE)
    strings = [found.string(counts=False)]
    number = found.length(MOST_NAMES)
    found.room(number)
    strings += [found.string() for _ in range(number)]
    count = found.length(MOST_NAMES)
    if count:
        found.align(8)
    found.room(8 * count)
    return Layout(tuple(strings), found.at, count, np.array(found.fixed))


def _reading_layout(data: bytes) -> Layout:
    found = _Reading(data, DISPLACEMENTS)
    frame = found.string(counts=False)
    found.align(8)
    found.room(27)
    return Layout((frame,), found.at, 3, np.array(found.fixed))


def _tables(
    messages: Sequence[bytes], layout_of: Callable[[bytes], Layout]
) -> Iterator[tuple[Rows, Bytes]]:
    """Messages of one layout as rows of bytes (N, length), and which they are."""
    found = 0
    lengths = np.fromiter(map(len, messages), dtype=np.int64, count=len(messages))
    for length in np.unique(lengths):
        rows = np.flatnonzero(lengths == length)
        joined = b''.join([messages[row] for row in rows])
        table = np.frombuffer(joined, dtype=np.uint8).reshape(len(rows), -1)
        while len(rows):
            fixed = layout_of(table[0].tobytes()).fixed
            alike = (table[:, fixed] == table[0, fixed]).all(axis=1)
            yield rows[alike], table[alike]
            found += 1
            if found > MOST_LAYOUTS:
                raise ValueError(f'more than {MOST_LAYOUTS} kinds of messages, as their names go')
            rows, table = rows[~alike], table[~alike]


def _column(table: Bytes, offset: int, kind: str, count: int) -> np.ndarray:
    size = np.dtype(kind).itemsize * count
    return np.ascontiguousarray(table[:, offset : offset + size]).view(kind)


def _stamps(table: Bytes) -> Rows:
    seconds, nanoseconds = _column(table, 4, '<i4', 1)[:, 0], _column(table, 8, '<u4', 1)[:, 0]
    stamps: Rows = seconds.astype(np.int64) * SECOND + nanoseconds
    return stamps


def little_endian(kind: str, data: bytes) -> bytes:
    """A message of the other byte order in this one's; as it is where that is so already.

    Raises:
        ValueError: the bytes do not hold such a message.
    """
    return cdr.encode(cdr.decode(kind, data)) if data[:2] == b'\x00\x00' else data


class MessageBlocks:
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
        self._decoded: list[Any] = []
        self._waiting: list[bytes] = []
        self._numbers: list[int] = []
        self._logged: list[int] = []
        self.count = 0

    def add(self, data: bytes, number: int, logged: int) -> None:
        self.count += 1
        self._waiting.append(data)
        self._numbers.append(number)
        self._logged.append(logged)
        if len(self._waiting) >= BLOCK:
            self.decode()

    def decode(self) -> None:
        waiting, self._waiting = self._waiting, []
        numbers, self._numbers = np.array(self._numbers, dtype=np.int64), []
        logged, self._logged = np.array(self._logged, dtype=np.int64), []
        try:
            messages = [little_endian(self.kind, data) for data in waiting]
            self._decoded += [
                replace(block, rows=numbers[block.rows], logged=logged[block.rows])
                for block in self._decode(messages)
            ]
        except ValueError as error:
            raise BagError(f'{self.path}: {self.topic}: {error}') from error
        if len(self._decoded) >= TOGETHER:
            self._into += _merged(self._decoded)

    def finish(self) -> None:
        """Let all that has come be one array for each column."""
        self.decode()
        self._into += _merged(self._decoded)
        self._into[:] = _merged(self._into)


def joined(parts: Sequence[np.ndarray], none: np.ndarray | None = None) -> Any:
    """Of one part no copy is made."""
    if len(parts) > 1:
        return np.concatenate(parts)
    return parts[0] if parts else np.zeros(0, np.int64) if none is None else none


def _merged(blocks: list[Any]) -> list[Any]:
    """Blocks with the same joints as one each; the list is emptied, column by column, so that
    hundreds of MB are never there twice."""
    kinds: dict[tuple[str, ...], list[Any]] = {}
    for block in blocks:
        kinds.setdefault(getattr(block, 'names', ()), []).append(block)
    blocks.clear()
    return [_one(kinds.pop(names)) for names in list(kinds)]


def _one(blocks: list[Any]) -> Any:
    columns = {
        each.name: [getattr(block, each.name) for block in blocks]
        for each in fields(blocks[0])
        if each.name != 'names'
    }
    first = blocks[0]
    blocks.clear()
    return replace(first, **{name: joined(columns.pop(name)) for name in list(columns)})
