# SPDX-License-Identifier: Apache-2.0
"""Reading a bag: ours, rosbag2's, split or compressed, whole or cut short."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Sequence
from io import BytesIO
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    Footer,
    McapRecord,
    Message,
    Metadata,
    Schema,
    Statistics,
)

from calib_model.bags.decompression import chunk_content, unpacked_zstd
from calib_model.bags.files import (
    ZSTD,
    bag_files,
    begins_with,
    is_sqlite,
    open_unpacked,
    size_of,
)
from calib_model.bags.record_reader import DAMAGE, MAGIC, RecordReader, another_follows
from calib_model.errors import BagError
from calib_model.files import open_file

RECORD = struct.Struct('<BQ')  # opcode and length
MESSAGE = struct.Struct('<HIQQ')  # channel, sequence, log time, publish time

#: bytes of a file for each of its messages, fewer are no recording but work for nothing, and the
#: messages that are read anyway
LEAST_MESSAGE, ANYWAY = 3.0, 1_000_000

Told = Callable[[int, int], None]  # bytes read so far, bytes in all


class BagMessage(NamedTuple):
    """One message as recorded; times in ns, `data` CDR with its 4-byte header.

    `offered_qos` is the channel's `offered_qos_profiles`, YAML text, empty where not recorded.
    """

    topic: str
    type: str
    log_time: int
    publish_time: int
    data: bytes
    offered_qos: str = ''


def read_messages(
    path: str | Path,
    topics: set[str] | None = None,
    cut_allowed: bool = True,
    told: Told | None = None,
) -> Iterator[BagMessage]:
    """The messages of a bag in the order of its files; only those of `topics` when given.

    A bag cut short (a crash, a kill) gives every complete chunk. Files and messages that rosbag2
    compressed are unpacked on the way. `told` hears how far it is.

    Raises:
        BagError: no bag there, not MCAP, not CDR, or damaged (when not merely cut short).
    """
    files = bag_files(path)
    ends = list(accumulate(size_of(file) for file in files))
    for before, file in zip([0, *ends], files, strict=False):
        total = ends[-1]

        def here(done: int, before: int = before, total: int = total) -> None:
            if told is not None:
                told(before + done, total)

        found: Iterator[BagMessage]
        try:
            if is_sqlite(file):
                found = _read_sqlite(file, topics)
            else:
                found = _read_file(file, topics, cut_allowed, here)
            for message in found:
                yield _unpacked(file, message) if message.data[:4] == ZSTD else message
        except OSError as error:
            raise BagError(f'{file}: cannot be read: {error.strerror}') from error


def _read_sqlite(file: Path, topics: set[str] | None) -> Iterator[BagMessage]:
    from calib_model.bags.sqlite import sqlite_rows  # most bags do without

    for name, kind, time, data, qos in sqlite_rows(file, topics):
        yield BagMessage(name, ros_type(kind), time, time, data, qos)


def _unpacked(file: Path, message: BagMessage) -> BagMessage:
    """A message that rosbag2 compressed by itself; CDR never begins like that."""
    try:
        data = unpacked_zstd(message.data)
    except (zstandard.ZstdError, ValueError, MemoryError) as error:
        raise BagError(f'{file}: damaged: a message on {message.topic}: {error}') from error
    return message._replace(data=data)


def read_note(path: str | Path, name: str) -> dict[str, str]:
    """The last metadata record of that name in a bag's files; empty when there is none.

    Raises:
        BagError: there is no bag at `path`, or it cannot be read.
    """
    return read_notes(path, (name,))[name]


def read_notes(path: str | Path, names: Sequence[str]) -> dict[str, dict[str, str]]:
    """As `read_note`, of several names: it takes a walk through all of the bag.

    Raises:
        BagError: there is no bag at `path`, or it cannot be read.
    """
    found: dict[str, dict[str, str]] = {name: {} for name in names}
    for file in bag_files(path):
        try:
            if is_sqlite(file):
                continue
            with open_unpacked(file) as stream:
                for record in RecordReader(stream).records:
                    if isinstance(record, Metadata) and record.name in found:
                        found[record.name] = dict(record.metadata)
        except OSError as error:
            raise BagError(f'{file}: cannot be read: {error.strerror}') from error
        except DAMAGE:
            continue  # cut short: what came before counts
    return found


def _read_file(
    file: Path, topics: set[str] | None, cut_allowed: bool, told: Callable[[int], None]
) -> Iterator[BagMessage]:
    known = _Known(file, topics)
    finished = False
    try:
        with open_file(file) as packed, open_unpacked(file, packed) as stream:
            reader = RecordReader(stream, validate_crcs=True)
            while True:
                finished = False
                for record in reader.records:
                    if isinstance(record, Chunk):
                        yield from known.messages_of(record)
                        told(packed.tell())
                    elif isinstance(record, Footer):
                        finished = True
                    elif (message := known.met(record)) is not None:
                        yield message
                if not another_follows(file, stream):
                    return
                # two recordings put into one file: each has numbers of its own
                known, reader = _Known(file, topics), RecordReader(stream, skip_magic=True)
    except DAMAGE as error:
        if finished:
            return
        cut = isinstance(error, EndOfFile | struct.error) and _lacks_end(file)
        if isinstance(error, InvalidMagic) or (cut and not known.channels):
            raise BagError(f'{file}: not an MCAP bag, or cut before its first chunk') from error
        if not (cut and cut_allowed):
            raise BagError(f'{file}: damaged: {error or type(error).__name__}') from error


class _Known:
    """What a file has said of its channels so far; None for those nobody asked for."""

    def __init__(self, file: Path, topics: set[str] | None) -> None:
        self._file = file
        self._topics = topics
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, tuple[str, str, str] | None] = {}
        self.count = 0
        self._most = max(ANYWAY, int(size_of(file) / LEAST_MESSAGE))

    def add(self, channel: Channel) -> None:
        """Take note of a channel; what nobody asked for by name may be in any encoding."""
        if self._topics is None:
            wanted = channel.message_encoding == 'cdr'
        else:
            wanted = channel.topic in self._topics
        self.channels[channel.id] = (
            _described(self._file, channel, self.schemas) if wanted else None
        )

    def met(self, record: McapRecord) -> BagMessage | None:
        """Take note of a record that is no chunk; its message, where it is one that is wanted."""
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.add(record)
        elif isinstance(record, Message):
            self.count += 1
            about = self.channels[record.channel_id]
            if about is not None:
                name, kind, qos = about
                times = (record.log_time, record.publish_time)
                return BagMessage(name, kind, *times, record.data, qos)
        elif isinstance(record, Statistics) and record.message_count != self.count:
            left = f'{self.count} of {record.message_count} messages are left'
            raise BagError(f'{self._file}: damaged: {left}')
        return None

    def messages_of(self, chunk: Chunk) -> list[BagMessage]:
        """The messages of a chunk, all of it or, when it is damaged, an error.

        The library's `breakup_chunk` does the same, several times slower.
        """
        content = chunk_content(chunk)
        length = len(content)
        found, at, count = [], 0, 0
        while at < length:
            opcode, size = RECORD.unpack_from(content, at)
            begin, at = at + RECORD.size, at + RECORD.size + size
            if at > length:
                raise EOFError('a chunk ends within a record')
            if opcode == Opcode.MESSAGE:
                count += 1
                if count > self._most:
                    self._refuse_so_many()
                number, _, logged, published = MESSAGE.unpack_from(content, begin)
                about = self.channels[number]
                if about is not None:
                    name, kind, qos = about
                    data = content[begin + MESSAGE.size : at]
                    found.append(BagMessage(name, kind, logged, published, data, qos))
            elif opcode == Opcode.CHANNEL:
                self.add(Channel.read(ReadDataStream(BytesIO(content[begin:at]))))
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(ReadDataStream(BytesIO(content[begin:at])))
                self.schemas[schema.id] = schema
        self.count += count
        if self.count > self._most:
            self._refuse_so_many()
        return found

    def _refuse_so_many(self) -> None:
        raise BagError(
            f'{self._file}: more than {self._most} messages in {size_of(self._file)} bytes: '
            'no recording is packed like that'
        )


def cut_files(path: str | Path) -> list[Path]:
    """The MCAP files of a bag that were cut short: what follows their last whole chunk is lost.

    Raises:
        BagError: there is no bag at `path`.
    """
    return [file for file in bag_files(path) if file.suffix == '.mcap' and _lacks_end(file)]


def _lacks_end(file: Path) -> bool:
    """Whether the file was cut; one that has its end and yet runs out has a wrong length in it."""
    if begins_with(file, ZSTD):
        return True
    with open_file(file) as stream:
        stream.seek(max(0, stream.seek(0, os.SEEK_END) - len(MAGIC)))
        return stream.read() != MAGIC


def _described(file: Path, channel: Channel, schemas: dict[int, Schema]) -> tuple[str, str, str]:
    """A channel's topic, type and offered QoS."""
    if channel.message_encoding != 'cdr':
        raise BagError(f'{file}: topic {channel.topic} is encoded as {channel.message_encoding!r}')
    schema = schemas.get(channel.schema_id)
    qos = channel.metadata.get('offered_qos_profiles', '')
    return channel.topic, ros_type(schema.name) if schema is not None else '', qos


def ros_type(name: str) -> str:
    """A type's name as ROS 2 has it: a recorder of DDS says `pkg::msg::dds_::Type_`."""
    parts = name.split('::')
    if len(parts) == 4 and parts[2] == 'dds_' and parts[3].endswith('_'):
        return f'{parts[0]}/{parts[1]}/{parts[3][:-1]}'
    return name
