# SPDX-License-Identifier: Apache-2.0
"""What is whole in one file of a bag, copied into another, and what was not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcap.records import (
    Channel,
    Chunk,
    DataEnd,
    McapRecord,
    Message,
    MessageIndex,
    Metadata,
    Schema,
    Statistics,
)
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.typesys import TypesysError

from calib_model.bags import cdr
from calib_model.bags.decompression import chunk_content, unpacked_zstd
from calib_model.bags.files import ZSTD, is_sqlite, open_unpacked, size_of
from calib_model.bags.metadata import Definition
from calib_model.bags.record_reader import DAMAGE, MAGIC, RecordReader
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError, DescriptionError
from calib_model.files import load_plain, open_file

if TYPE_CHECKING:
    from calib_model.bags.sqlite import KeptRow, KeptTopic


@dataclass
class Recovery:
    """What came back of a bag, by topic, and what did not.

    `lost` counts messages that the file itself says are missing; `unread` are bytes at the end of
    which nothing could be made. `open_ends` are files without an end: what their recorder had not
    yet written, nobody can know. `behind` are bytes after a file's end that are no recording.
    """

    counts: dict[str, int] = field(default_factory=dict)
    lost: int = 0
    damaged_chunks: int = 0
    unread: int = 0
    open_ends: int = 0
    behind: int = 0

    @property
    def messages(self) -> int:
        """How many messages came back."""
        return sum(self.counts.values())

    @property
    def lossy(self) -> bool:
        """Whether anything is missing, or may be."""
        return bool(self.lost or self.damaged_chunks or self.open_ends or self.behind)

    def loss(self) -> str:
        """What is missing, in words."""
        parts = []
        if self.damaged_chunks:
            s = 's' if self.damaged_chunks > 1 else ''
            parts.append(f'{self.damaged_chunks} damaged chunk{s}')
        if self.lost:
            parts.append(f'{self.lost} message{"s" if self.lost > 1 else ""} known to be missing')
        if self.open_ends:
            parts.append(f'no end of the recording, {self.unread} bytes of an unfinished chunk')
        if self.behind:
            parts.append(f'{self.behind} bytes behind the end')
        return '; '.join(parts) or 'nothing'


@dataclass
class _Known:
    """What a file has said of itself so far."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    defined: dict[str, Channel] = field(default_factory=dict)  # by topic, as the copy has it
    messages: int = 0
    damaged: bool = False
    ended: bool = False


def copy_whole(
    file: Path,
    bag: BagWriter,
    found: Recovery,
    pace: Callable[[int, int], None] = lambda done, planned: None,
) -> None:
    """Copy every message of a file, MCAP or SQLite, that can be read, and count the rest into
    `found`; `pace` hears of the bytes that are done, of how many.

    Raises:
        BagError: the file cannot be read, or the copy cannot be written.
    """
    (_copy_sqlite if is_sqlite(file) else _copy_mcap)(file, bag, found, pace)


def _copy_mcap(
    file: Path, bag: BagWriter, found: Recovery, pace: Callable[[int, int], None]
) -> None:
    """Copy every message of an MCAP file that can be read."""
    known, indexed, told = _Known(), 0, -1
    used, size = 0, size_of(file)
    try:
        with open_file(file) as packed, open_unpacked(file, packed) as stream:
            skip_magic = False
            while True:
                reader = RecordReader(stream, skip_magic=skip_magic, indexes=True)
                for record in _until_damage(reader):
                    used = packed.tell()
                    pace(used, size)
                    if isinstance(record, Chunk):
                        known.damaged = not _copy_chunk(record, bag, known, found)
                    elif isinstance(record, MessageIndex) and known.damaged:
                        indexed += len(record.records)
                    elif isinstance(record, Statistics):
                        told = record.message_count
                    elif isinstance(record, DataEnd):
                        known.ended = True
                    else:
                        _copy_record(record, bag, known, found)
                behind = stream.read(len(MAGIC)) if known.ended else b''
                if behind != MAGIC:
                    break
                # two recordings put into one file: each has numbers of its own
                found.lost += max(indexed, told - known.messages)
                known, indexed, told, skip_magic = _Known(), 0, -1, True
            if behind:
                found.behind += size - packed.tell() + len(behind)
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror}') from error
    found.lost += max(indexed, told - known.messages)
    if not known.ended:
        found.open_ends += 1
        found.unread += size - used


def _copy_sqlite(
    file: Path, bag: BagWriter, found: Recovery, pace: Callable[[int, int], None]
) -> None:
    """Copy every message of an SQLite file; of a damaged one what can be read from both ends."""
    from calib_model.bags.sqlite import kept_rows  # most bags do without

    size, used, before = size_of(file), 0, 0
    defined: dict[str, KeptTopic] = {}
    numbers: list[int] = []

    def taken(row: KeptRow) -> None:
        nonlocal used
        numbers.append(row.number)
        used += len(row.data)
        pace(min(used, size), size)
        data = row.data
        if row.topic.encoding == 'cdr' and data[:4] == ZSTD:
            try:
                data = unpacked_zstd(data)
            except DAMAGE:
                found.lost += 1
                return
        if defined.get(row.topic.name) is not row.topic:
            bag.define(_kept_definition(row.topic))
            defined[row.topic.name] = row.topic
        bag.add(row.topic.name, data, row.time, row.time)
        found.counts[row.topic.name] = found.counts.get(row.topic.name, 0) + 1

    try:
        for row in kept_rows(file):
            taken(row)
    except BagError:
        found.damaged_chunks += 1
        before = numbers[-1] if numbers else 0
        rest = []
        with suppress(BagError):
            for row in kept_rows(file, backwards=True):
                if row.number <= before:
                    break
                rest.append(row)
        for row in reversed(rest):
            taken(row)
    if numbers:  # rows are numbered without a gap
        found.lost += max(numbers) - min(numbers) + 1 - len(numbers)


def _kept_definition(topic: KeptTopic) -> Definition:
    schema, encoding = topic.schema.encode(), topic.schema_encoding
    if not schema and topic.encoding == 'cdr':
        with suppress(TypesysError):  # a type that nobody here knows
            schema, encoding = cdr.schema_text(topic.type), 'ros2msg'
    return Definition(
        topic.name,
        topic.type,
        schema,
        encoding or 'ros2msg',
        _profiles(topic.offered_qos, topic.name),
        topic.type_hash,
        topic.encoding,
    )


def _until_damage(reader: StreamReader) -> Iterator[McapRecord]:
    try:
        yield from reader.records
    except DAMAGE:
        return


def _copy_chunk(chunk: Chunk, bag: BagWriter, known: _Known, found: Recovery) -> bool:
    """Copy a chunk, all of it or, when it is damaged, nothing; returns whether it was whole."""
    try:
        content = chunk_content(chunk)
        plain = replace(chunk, compression='', data=content, uncompressed_crc=0)
        records = breakup_chunk(plain)
    except DAMAGE:
        found.damaged_chunks += 1
        return False
    for record in records:
        _copy_record(record, bag, known, found)
    return True


def _copy_record(record: McapRecord, bag: BagWriter, known: _Known, found: Recovery) -> None:
    if isinstance(record, Schema):
        known.schemas[record.id] = record
    elif isinstance(record, Channel):
        known.channels[record.id] = record
    elif isinstance(record, Metadata):
        bag.note(record.name, record.metadata)
    elif isinstance(record, Message) and record.channel_id in known.channels:
        channel = known.channels[record.channel_id]
        if known.defined.get(channel.topic) is not channel:  # it takes longer than a message
            bag.define(_definition(channel, known.schemas.get(channel.schema_id)))
            known.defined[channel.topic] = channel
        data = record.data
        if channel.message_encoding == 'cdr' and data[:4] == ZSTD:  # CDR never begins like that
            try:
                data = unpacked_zstd(data)
            except DAMAGE:
                known.messages += 1  # the file counts it
                found.lost += 1
                return
        bag.add(channel.topic, data, record.log_time, record.publish_time)
        known.messages += 1
        found.counts[channel.topic] = found.counts.get(channel.topic, 0) + 1


def _definition(channel: Channel, schema: Schema | None) -> Definition:
    return Definition(
        channel.topic,
        schema.name if schema is not None else '',
        schema.data if schema is not None else b'',
        schema.encoding if schema is not None else '',
        _profiles(channel.metadata.get('offered_qos_profiles', ''), channel.topic),
        channel.metadata.get('topic_type_hash', ''),
        channel.message_encoding,
    )


def _profiles(text: str, topic: str) -> list[dict[str, Any]]:
    try:
        qos = load_plain(text, topic)
    except DescriptionError:
        return []
    return qos if isinstance(qos, list) else []
