# SPDX-License-Identifier: Apache-2.0
"""Writing a bag: one MCAP as rosbag2 makes it, with its metadata.yaml beside it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.writer import CompressionType, Writer

from calib_model.bags import cdr
from calib_model.bags.files import METADATA
from calib_model.bags.metadata import Definition, FileAccount, metadata_yaml
from calib_model.errors import BagError
from calib_model.files import TAKEN, HeldFolder
from calib_model.topics import Topic


class BagWriter:
    """A bag being recorded; `path` is its folder, which must not exist.

    What was written before the last `flush` is on disk and readable whatever happens next.
    With `earlier` the folder is a bag of these complete files, and this writes the next one:
    until the first `flush` the bag stays what it was.

    Raises:
        BagError: the folder exists or cannot be made, or the disk is full.
    """

    def __init__(
        self,
        path: str | Path,
        chunk_size: int = 256 * 1024,
        earlier: Sequence[FileAccount] = (),
    ) -> None:
        self.path = Path(path)
        self._earlier = tuple(earlier)
        self._account = FileAccount(f'{self.path.name}_{len(self._earlier)}.mcap')
        self._channels: dict[tuple[str, str, str], int] = {}
        self._latest: dict[str, int] = {}  # the channel that a topic's messages go to
        self._schemas: dict[tuple[str, str], int] = {}
        self._closed = self._listed = False
        self._safe = 0  # bytes that a flush has put on disk
        try:
            self._folder = (
                HeldFolder(self.path, writing=True) if self._earlier else HeldFolder.new(self.path)
            )
            self._folder.remove(self._account.name)
            self._stream = self._folder.new_file(self._account.name)
        except FileExistsError:
            raise BagError(TAKEN.format(self.path)) from None
        except OSError as error:
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from error
        self._disk = _Disk(self.path)
        self._writer = Writer(self._stream, chunk_size, CompressionType.ZSTD)
        with self._disk:
            self._writer.start(profile='ros2', library='calib_model')
            if not self._earlier:
                self._write_metadata()

    def write(self, topic: Topic, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message, CDR `data` with its 4-byte header; times in ns."""
        if topic.name not in self._latest:
            self.define(Definition.of(topic))
        self.add(topic.name, data, log_time, publish_time)

    def write_message(self, topic: Topic, message: Any, time: int) -> None:
        """Add a message made by `calib_model.bags.cdr`, received when it was sent (ns)."""
        self.write(topic, cdr.encode(message), time, time)

    def define(self, definition: Definition) -> None:
        """Open the channel of a topic, once; messages of the topic go there from now on."""
        if definition.channel not in self._channels:
            schema = definition.type, definition.encoding
            with self._disk:
                if schema not in self._schemas:
                    self._schemas[schema] = self._writer.register_schema(*schema, definition.schema)
                self._channels[definition.channel] = self._writer.register_channel(
                    definition.topic,
                    definition.message_encoding,
                    self._schemas[schema],
                    definition.channel_metadata(),
                )
            self._account.definitions[definition.topic] = definition
        self._latest[definition.topic] = self._channels[definition.channel]

    def add(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message to a topic that was defined; a bag knows no time before 1970, ns 0."""
        log_time, publish_time = max(log_time, 0), max(publish_time, 0)
        count = self._account.counts.get(topic, 0)
        with self._disk:
            self._writer.add_message(self._latest[topic], log_time, data, publish_time, count)
        self._account.add(topic, log_time)

    def note(self, name: str, content: dict[str, str]) -> None:
        """Add a metadata record of the MCAP: settings and the like, not seen as messages."""
        with self._disk:
            self._writer.add_metadata(name, content)

    def flush(self) -> None:
        """Put everything written so far on disk, in a complete chunk."""
        with self._disk:
            self._writer.flush()
            os.fsync(self._stream.fileno())
            self._safe = self._stream.tell()
            if self._earlier and not self._listed:
                self._write_metadata()

    def close(self) -> FileAccount:
        """Write index and metadata; further calls do nothing. Returns what the file holds."""
        if self._closed:
            return self._account
        self._closed = True
        try:
            if not self._disk.failed:
                with self._disk:
                    self._writer.finish()
                    self._stream.flush()
                    os.fsync(self._stream.fileno())
                    self._safe = self._stream.tell()
                    self._write_metadata()
        finally:
            self._let_go()
            self._folder.close()
        return self._account

    def _let_go(self) -> None:
        """Close the file; after a write that failed, without the piece that came of it."""
        if not self._disk.failed:
            self._stream.close()
            return
        with suppress(OSError):  # what is buffered still cannot be written
            self._stream.close()
        with suppress(OSError), self._folder.open_to_change(self._account.name) as stream:
            stream.truncate(self._safe)

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write_metadata(self) -> None:
        self._listed = True
        text = metadata_yaml((*self._earlier, self._account))
        self._folder.write_together({METADATA: text.encode()})


class _Disk:
    """Turns a failing disk into one line that names the bag, and remembers that it failed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failed = False

    def __enter__(self) -> None:
        return None

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if isinstance(error, OSError):
            self.failed = True
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from error
