# SPDX-License-Identifier: Apache-2.0
"""Bags in rosbag2's other storage: an SQLite file with a table of topics and one of messages."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import IO, NamedTuple

import zstandard

from calib_model.bags.decompression import LARGEST_RECORD
from calib_model.bags.files import ZSTD, begins_with, open_unpacked, size_of
from calib_model.errors import BagError
from calib_model.files import HeldFolder, is_there, open_file, reach, working_folder

STEP = 1 << 20  # bytes that are copied at once
NONE = '', ''
Row = tuple[str, str, int, bytes, str]  # topic, type, time in ns, data, offered QoS


def sqlite_rows(file: Path, topics: set[str] | None) -> Iterator[Row]:
    """The messages of an SQLite file in recorded order; only those of `topics` when given.

    Raises:
        BagError: the file is damaged or not a bag's.
    """
    try:
        with _opened(file) as base:
            yield from _rows(file, base, topics)
    except (sqlite3.Error, zstandard.ZstdError) as error:
        raise BagError(f'{file}: not a bag, or damaged: {error}') from error


class KeptTopic(NamedTuple):
    """All that a file says of a topic, as it stands there; `schema` is the text of its type."""

    name: str
    type: str
    encoding: str
    offered_qos: str = ''
    type_hash: str = ''
    schema: str = ''
    schema_encoding: str = ''


class KeptRow(NamedTuple):
    """A message as it stands in the file; `number` counts the rows that were ever written."""

    number: int
    topic: KeptTopic
    time: int
    data: bytes


def kept_rows(file: Path, backwards: bool = False) -> Iterator[KeptRow]:
    """Every message of an SQLite file, whatever its encoding, in the order it was written or
    `backwards`: of a damaged file as far as it can be read from that side.

    Raises:
        BagError: nothing more can be read.
    """
    way = 'DESC' if backwards else 'ASC'
    try:
        with _opened(file) as base:
            known = _kept_topics(base)
            rows = base.execute(
                f'SELECT id, topic_id, timestamp, data FROM messages ORDER BY id {way}'
            )
            for number, topic, time, data in rows:
                if isinstance(time, int) and isinstance(data, bytes) and topic in known:
                    yield KeptRow(number, known[topic], time, data)
    except (sqlite3.Error, zstandard.ZstdError) as error:
        raise BagError(f'{file}: not a bag, or damaged: {error}') from error


def _kept_topics(base: sqlite3.Connection) -> dict[int, KeptTopic]:
    there = {row[1] for row in base.execute('PRAGMA table_info(topics)')}
    more = [
        name if name in there else "''"
        for name in ('offered_qos_profiles', 'type_description_hash')
    ]
    found = base.execute(
        f'SELECT id, name, type, serialization_format, {", ".join(more)} FROM topics'
    )
    texts: dict[str, tuple[str, str]] = {}
    if list(base.execute('PRAGMA table_info(message_definitions)')):
        defined = base.execute(
            'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions'
        )
        texts = {str(kind): (str(text), str(form)) for kind, text, form in defined}
    return {
        number: KeptTopic(
            str(name), str(kind), str(form), str(qos), str(of), *texts.get(kind, NONE)
        )
        for number, name, kind, form, qos, of in found
    }


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """The file as a database.

    Journals beside it: a recorder was stopped hard, and SQLite puts the newest rows in their place
    as it opens the file. Then it is a copy, so that the bag stays as it is; and where paths are
    confined, for SQLite opens by name.
    """
    journals = journals_of(file)
    packed = begins_with(file, ZSTD)
    if not (journals or packed or reach() is not None):
        with closing(_connected(file, immutable=True)) as base:
            yield base
        return
    with (
        HeldFolder.temporary() as above,
        working_folder(above, 'calib_sqlite', mode=0o700) as folder,
    ):
        plain = file.stem if packed else file.name
        with open_unpacked(file) as content:
            _copy(content, folder, plain)
        for one in journals:
            with open_file(one) as content:
                _copy(content, folder, one.name)
        with closing(_connected(folder.path / plain, immutable=not journals)) as base:
            yield base


def _connected(file: Path, immutable: bool) -> sqlite3.Connection:
    address = f'{file.resolve().as_uri()}{"?immutable=1" if immutable else ""}'
    return sqlite3.connect(address, uri=True)


def _copy(content: IO[bytes], folder: HeldFolder, name: str) -> None:
    with folder.new_file(name) as copied:
        shutil.copyfileobj(content, copied, STEP)


def journals_of(file: Path) -> list[Path]:
    """The journals beside an SQLite file that hold rows which are not in it yet."""
    found = (file.with_name(f'{file.name}{end}') for end in ('-wal', '-journal'))
    return [one for one in found if is_there(one) and size_of(one) > 0]


def _rows(file: Path, base: sqlite3.Connection, topics: set[str] | None) -> Iterator[Row]:
    columns = {row[1] for row in base.execute('PRAGMA table_info(topics)')}
    qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
    known = {}
    for number, name, kind, form, offered in base.execute(
        f'SELECT id, name, type, serialization_format, {qos} FROM topics'
    ):
        if topics is not None and name in topics and form != 'cdr':
            raise BagError(f'{file}: topic {name} is encoded as {form!r}')
        if form == 'cdr' and (topics is None or name in topics):
            known[number] = str(name), str(kind), str(offered)
    marks = ','.join('?' * len(known))
    found = base.execute(
        f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) '
        'ORDER BY timestamp, id',
        tuple(known),
    )
    for number, time, data in found:
        name, kind, offered = known[number]
        if not isinstance(time, int) or not isinstance(data, bytes):
            raise BagError(f'{file}: damaged: a message on {name} is none')
        if len(data) > LARGEST_RECORD:
            raise BagError(f'{file}: damaged: a message on {name} of {len(data)} bytes')
        yield name, kind, time, data, offered
