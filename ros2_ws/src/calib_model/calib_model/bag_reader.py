# SPDX-License-Identifier: Apache-2.0
"""Reading a bag: ours, rosbag2's, whole or cut short."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
import zstandard
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Channel, Footer, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader

from calib_model.errors import BagError

# what a damaged file makes the reader and its decompressors raise; a wrong size asks for memory
DAMAGE = (
    McapError, struct.error, ValueError, KeyError, EOFError, OverflowError, RuntimeError,
    MemoryError, zstandard.ZstdError,
)  # fmt: skip
LARGEST_RECORD = 1 << 30
MAGIC = b'\x89MCAP0\r\n'


@dataclass(frozen=True)
class BagMessage:
    """One message as recorded; times in ns, `data` CDR with its 4-byte header.

    `offered_qos` is the channel's `offered_qos_profiles`, YAML text, empty where not recorded.
    """

    topic: str
    type: str
    log_time: int
    publish_time: int
    data: bytes
    offered_qos: str = ''


def bag_files(path: str | Path) -> list[Path]:
    """The MCAP files of a bag: of its folder in recorded order, or the file itself.

    Raises:
        BagError: there is no bag at `path`.
    """
    path = Path(path)
    if not os.path.exists(path):  # false, too, for a name that no file can have
        raise BagError(f'{path}: no such bag')
    if path.is_file():
        return [path]
    listed = _listed_files(path) or files_in(path)
    if not listed:
        raise BagError(f'{path}: no .mcap file in this folder')
    for file in listed:
        if not file.is_file():
            raise BagError(f'{path}: metadata.yaml names {file.name}, which is missing')
    return listed


def files_in(folder: Path) -> list[Path]:
    """The MCAP files of a folder in recorded order, whatever its metadata.yaml says."""
    def recorded(file: Path) -> list[int | str]:
        parts = re.split(r'(\d+)', file.name)  # rosbag2 counts: _9 comes before _10
        return [int(part) if part.isdecimal() else part for part in parts]

    return sorted(folder.glob('*.mcap'), key=recorded)


def _listed_files(folder: Path) -> list[Path]:
    metadata = folder / 'metadata.yaml'
    if not metadata.is_file():
        return []
    try:
        content = yaml.safe_load(metadata.read_text(encoding='utf-8'))
        information = content['rosbag2_bagfile_information']
        files = [folder / Path(str(name)).name for name in information['relative_file_paths']]
        mode = str(information.get('compression_mode') or '').lower()
    except (OSError, ValueError, yaml.YAMLError, TypeError, KeyError, AttributeError) as error:
        raise BagError(f'{metadata}: not a rosbag2 metadata file') from error
    if mode in ('file', 'message'):
        # around the MCAP, not within it as rosbag2's storage presets do
        raise BagError(f'{folder}: every {mode} is compressed by rosbag2, which is not read here')
    return files


def read_messages(
    path: str | Path, topics: set[str] | None = None, cut_allowed: bool = True
) -> Iterator[BagMessage]:
    """The messages of a bag in the order of the file; only those of `topics` when given.

    A bag cut short (a crash, a kill) gives every complete chunk.

    Raises:
        BagError: no bag there, not MCAP, not CDR, or damaged (when not merely cut short).
    """
    for file in bag_files(path):
        yield from _read_file(file, topics, cut_allowed)


def read_note(path: str | Path, name: str) -> dict[str, str]:
    """The last metadata record of that name in a bag's files; empty when there is none.

    Raises:
        BagError: there is no bag at `path`, or it cannot be read.
    """
    found: dict[str, str] = {}
    for file in bag_files(path):
        try:
            with file.open('rb') as stream:
                reader = StreamReader(
                    stream, emit_chunks=True, record_size_limit=LARGEST_RECORD
                )
                for record in reader.records:
                    if isinstance(record, Metadata) and record.name == name:
                        found = dict(record.metadata)
        except OSError as error:
            raise BagError(f'{file}: cannot be read: {error.strerror}') from error
        except DAMAGE:
            continue  # cut short: what came before counts
    return found


def _read_file(file: Path, topics: set[str] | None, cut_allowed: bool) -> Iterator[BagMessage]:
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[str, str, str]] = {}
    count, finished = 0, False
    try:
        with file.open('rb') as stream:
            reader = StreamReader(stream, validate_crcs=True, record_size_limit=LARGEST_RECORD)
            for record in reader.records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    channels[record.id] = _described(file, record, schemas)
                elif isinstance(record, Message):
                    count += 1
                    topic, kind, qos = channels[record.channel_id]
                    if topics is None or topic in topics:
                        times = (record.log_time, record.publish_time)
                        yield BagMessage(topic, kind, *times, record.data, qos)
                elif isinstance(record, Statistics) and record.message_count != count:
                    raise BagError(
                        f'{file}: damaged: {count} of {record.message_count} messages are left'
                    )
                elif isinstance(record, Footer):
                    finished = True
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror}') from error
    except DAMAGE as error:
        if finished:
            return
        cut = isinstance(error, EndOfFile | struct.error) and _lacks_end(file)
        if isinstance(error, InvalidMagic) or (cut and not channels):
            raise BagError(f'{file}: not an MCAP bag, or cut before its first chunk') from error
        if not (cut and cut_allowed):
            raise BagError(f'{file}: damaged: {error or type(error).__name__}') from error


def _lacks_end(file: Path) -> bool:
    """Whether the file was cut; one that has its end and yet runs out has a wrong length in it."""
    with file.open('rb') as stream:
        stream.seek(max(0, file.stat().st_size - len(MAGIC)))
        return stream.read() != MAGIC


def _described(
    file: Path, channel: Channel, schemas: dict[int, Schema]
) -> tuple[str, str, str]:
    """A channel's topic, type and offered QoS."""
    if channel.message_encoding != 'cdr':
        raise BagError(f'{file}: topic {channel.topic} is encoded as {channel.message_encoding!r}')
    schema = schemas.get(channel.schema_id)
    qos = channel.metadata.get('offered_qos_profiles', '')
    return channel.topic, schema.name if schema is not None else '', qos
