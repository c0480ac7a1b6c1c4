# SPDX-License-Identifier: Apache-2.0
"""Writing a bag: one MCAP as rosbag2 makes it, with its metadata.yaml beside it."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from calib_model import cdr
from calib_model.errors import BagError
from calib_model.topics import Topic


@dataclass
class _Channel:
    topic: Topic
    id: int
    count: int = 0


@dataclass
class _Extent:
    """First and last log time, ns."""

    first: int = 0
    last: int = 0
    seen: bool = field(default=False)

    def add(self, time: int) -> None:
        self.first = min(self.first, time) if self.seen else time
        self.last = max(self.last, time) if self.seen else time
        self.seen = True


class BagWriter:
    """A bag being recorded; `path` is its folder, which must not exist.

    What was written before the last `flush` is on disk and readable whatever happens next.

    Raises:
        BagError: the folder exists or cannot be made, or the disk is full.
    """

    def __init__(self, path: str | Path, chunk_size: int = 256 * 1024) -> None:
        self.path = Path(path)
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._extent = _Extent()
        self._closed = False
        file = self.path / f'{self.path.name}_0.mcap'
        try:
            self.path.mkdir(parents=True)
            self._stream = file.open('wb')
        except FileExistsError:
            raise BagError(f'{self.path}: exists already, a bag is never overwritten') from None
        except OSError as error:
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from error
        self._writer = Writer(self._stream, chunk_size, CompressionType.ZSTD)
        with _Disk(self.path):
            self._writer.start(profile='ros2', library='calib_model')
            self._write_metadata()

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message, CDR `data` with its 4-byte header; times in ns."""
        with _Disk(self.path):
            channel = self._channels.get(topic.name) or self._open_channel(topic)
            self._writer.add_message(channel.id, log_time, data, publish_time, channel.count)
        channel.count += 1
        self._extent.add(log_time)

    def write_message(self, topic: Topic, message: Any, time: int) -> None:
        """Add a message made by `calib_model.cdr`, received when it was sent (ns)."""
        self.write(topic, cdr.encode(message), time, time)

    def flush(self) -> None:
        """Put everything written so far on disk, in a complete chunk."""
        with _Disk(self.path):
            self._writer.flush()
            os.fsync(self._stream.fileno())

    def close(self) -> None:
        """Write index and metadata; further calls do nothing."""
        if self._closed:
            return
        self._closed = True
        try:
            with _Disk(self.path):
                self._writer.finish()
                self._stream.flush()
                os.fsync(self._stream.fileno())
                self._write_metadata()
        finally:
            self._stream.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _open_channel(self, topic: Topic) -> _Channel:
        if topic.type not in self._schemas:
            text = cdr.schema_text(topic.type)
            self._schemas[topic.type] = self._writer.register_schema(topic.type, 'ros2msg', text)
        # the same text as in metadata.yaml: readers drop topics where the two differ
        qos = yaml.safe_dump(topic.offered_qos(), sort_keys=False)
        channel_id = self._writer.register_channel(
            topic.name, 'cdr', self._schemas[topic.type],
            {'offered_qos_profiles': qos, 'topic_type_hash': cdr.type_hash(topic.type)},
        )  # fmt: skip
        channel = self._channels[topic.name] = _Channel(topic, channel_id)
        return channel

    def _write_metadata(self) -> None:
        text = yaml.safe_dump(
            {'rosbag2_bagfile_information': self._metadata()}, sort_keys=False, width=1000
        )
        write_whole(self.path / 'metadata.yaml', text)

    def _metadata(self) -> dict[str, Any]:
        name = f'{self.path.name}_0.mcap'
        span = {
            'starting_time': {'nanoseconds_since_epoch': self._extent.first},
            'duration': {'nanoseconds': self._extent.last - self._extent.first},
            'message_count': sum(channel.count for channel in self._channels.values()),
        }
        topics = [
            {
                'topic_metadata': {
                    'name': channel.topic.name,
                    'type': channel.topic.type,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': channel.topic.offered_qos(),
                    'type_description_hash': cdr.type_hash(channel.topic.type),
                },
                'message_count': channel.count,
            }
            for channel in self._channels.values()
        ]
        return {
            'version': 9,
            'storage_identifier': 'mcap',
            **{key: span[key] for key in ('duration', 'starting_time', 'message_count')},
            'topics_with_message_count': topics,
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name],
            'files': [{'path': name, **{key: dict(value) if isinstance(value, dict) else value
                                        for key, value in span.items()}}],
            'custom_data': None,
            'ros_distro': 'jazzy',
        }  # fmt: skip


class _Disk:
    """Turns a failing disk into one line that names the bag."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __enter__(self) -> None:
        return None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if isinstance(error, OSError):
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from error


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all.

    Raises:
        OSError: it could not be written; what was there before is still there.
    """
    path = Path(path)
    part = path.with_name(f'.{path.name}.{os.getpid()}.part')
    try:
        with part.open('w', encoding='utf-8') as stream:
            stream.write(text)
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
