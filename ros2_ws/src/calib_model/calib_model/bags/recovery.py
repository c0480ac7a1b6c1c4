# SPDX-License-Identifier: Apache-2.0
"""Getting out of a damaged bag what is whole in it: every complete chunk."""

from __future__ import annotations

import os
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
from calib_model.bags.files import (
    METADATA,
    ZSTD,
    bag_files,
    files_in,
    is_sqlite,
    left_aside,
    open_unpacked,
    size_of,
    unlisted_files,
)
from calib_model.bags.metadata import Definition, FileAccount, metadata_yaml
from calib_model.bags.record_reader import DAMAGE, MAGIC, RecordReader
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError, DescriptionError
from calib_model.files import (
    HeldFolder,
    load_plain,
    made_whole,
    open_file,
    refuse_taken,
    remove_dead_folders,
    working_folder,
)
from calib_model.progress import Pace, Progress

if TYPE_CHECKING:
    from calib_model.bags.sqlite import KeptRow, KeptTopic

UNBEGUN = 1 << 16  # bytes: a recording's first chunk, the descriptions, is smaller


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


def recover(bad: str | Path, out: str | Path, progress: Progress | None = None) -> Recovery:
    """Copy what is whole in the bag `bad` to a new bag `out`, made whole or not at all; `progress`
    hears how far it is.

    Raises:
        BagError: no bag at `bad`, nothing in it to be had, or `out` exists or cannot be written.
    """
    bad, out = Path(bad), Path(out)
    refuse_taken(out)
    files, found = _files_of(bad), Recovery()
    with made_whole(out) as part:
        with BagWriter(part, chunk_size=1 << 20) as bag:
            for file in files:
                pace = Pace(progress, f'copying {file}', 'MB', 1e6)
                (_copy_sqlite if is_sqlite(file) else _copy)(file, bag, found, pace)
                pace.end()
        if not found.messages:
            raise BagError(f'{bad}: no complete chunk in it, nothing can be recovered')
    return found


def repair(bag: str | Path, told: Callable[[str], None] = lambda line: None) -> list[FileAccount]:
    """Make every file of a bag's folder complete, in its place; what each then holds.

    `told` gets a line for each file that was not complete.

    A file is exchanged for its recovered copy in one step, so that a repair cut short does no
    harm. Files that are complete stay as they are. One that was cut before its first chunk is
    taken away, and with the last of them the folder.

    Raises:
        BagError: no bag there, nothing in a file that once held something, or the bag cannot be
            written.
    """
    folder = Path(bag)
    try:
        with HeldFolder(folder, writing=True) as held:
            return _repaired_in(held, told)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise BagError(f'{folder}: no such bag') from error
    except OSError as error:
        raise BagError(f'{folder}: cannot be written: {error.strerror}') from error


def _repaired_in(held: HeldFolder, told: Callable[[str], None]) -> list[FileAccount]:
    files = files_in(held.path)
    if not files and not held.has(METADATA):
        raise BagError(f'{held.path}: no such bag')
    held.remove_dead_parts((METADATA,))
    remove_dead_folders(held, 'repair')
    for name in held.names():
        if name.startswith('.repair-'):  # of 0.1.0
            held.remove_tree(name)
    accounts = []
    for file in files:
        account = _repaired(held, file, told)
        if account.messages:
            accounts.append(account)
        elif size_of(file) > UNBEGUN:
            raise BagError(f'{file}: no complete chunk in it, nothing can be recovered')
        else:
            held.remove(file.name)
    if accounts:
        held.write_together({METADATA: metadata_yaml(accounts).encode()})
        return accounts
    held.remove(METADATA)
    if not held.names() and held.current:
        held.path.rmdir()
    return accounts


def _repaired(held: HeldFolder, file: Path, told: Callable[[str], None]) -> FileAccount:
    with working_folder(held, 'repair') as part:
        found, copy = Recovery(), BagWriter(part.path / 'copy')
        with copy:
            _copy(file, copy, found)
        account = copy.close()
        if found.lossy:
            told(f'{file}: {found.messages} messages recovered, missing: {found.loss()}')
        if found.lossy and found.messages:
            with HeldFolder.below(part, 'copy') as made:
                os.replace(
                    account.name,
                    file.name,
                    src_dir_fd=made.descriptor,
                    dst_dir_fd=held.descriptor,
                )
    account.name = file.name
    return account


def _files_of(bad: Path) -> list[Path]:
    try:
        # what metadata.yaml does not list may be the rest of a copy that was made in part
        files = [*bag_files(bad), *left_aside(bad)]
    except BagError:
        # a metadata.yaml that was not finished either: the files speak for themselves
        files = unlisted_files(bad) if bad.is_dir() else []
        if not files:
            raise
    for file in files:
        size_of(file)  # names a pipe
    return files


@dataclass
class _Known:
    """What a file has said of itself so far."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    defined: dict[str, Channel] = field(default_factory=dict)  # by topic, as the copy has it
    messages: int = 0
    damaged: bool = False
    ended: bool = False


def _copy(
    file: Path,
    bag: BagWriter,
    found: Recovery,
    pace: Callable[[int, int], None] = lambda done, planned: None,
) -> None:
    """Copy every message of a file that can be read, and count the rest."""
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
