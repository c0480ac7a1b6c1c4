# SPDX-License-Identifier: Apache-2.0
"""Bags in rosbag2's other storage: an SQLite file with a table of topics and one of messages."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import IO

import zstandard

from calib_model.bags.decompression import LARGEST_RECORD
from calib_model.bags.files import ZSTD, begins_with, open_unpacked, size_of
from calib_model.errors import BagError
from calib_model.files import HeldFolder, is_there, open_file, reach, working_folder

STEP = 1 << 20  # bytes that are copied at once
Row = tuple[str, str, int, bytes, str]  # topic, type, time in ns, data, offered QoS


def sqlite_rows(file: Path, topics: set[str] | None) -> Iterator[Row]:
    """The messages of an SQLite file in recorded order; only those of `topics` when given.

    Raises:
        BagError: the file is damaged or not a bag's.
    """
    try:
        journals = journals_of(file)
        packed = begins_with(file, ZSTD)
        if not (journals or packed or reach() is not None):
            yield from _rows(file, topics)
            return
        # journals: a recorder was stopped hard, and SQLite puts the newest rows in their place as
        # it opens the file. Here a copy, so that the bag stays as it is; and SQLite opens by name
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
            yield from _rows(folder.path / plain, topics, immutable=not journals)
    except (sqlite3.Error, zstandard.ZstdError) as error:
        raise BagError(f'{file}: not a bag, or damaged: {error}') from error


def _copy(content: IO[bytes], folder: HeldFolder, name: str) -> None:
    with folder.new_file(name) as copied:
        shutil.copyfileobj(content, copied, STEP)


def journals_of(file: Path) -> list[Path]:
    """The journals beside an SQLite file that hold rows which are not in it yet."""
    found = (file.with_name(f'{file.name}{end}') for end in ('-wal', '-journal'))
    return [one for one in found if is_there(one) and size_of(one) > 0]


def _rows(file: Path, topics: set[str] | None, immutable: bool = True) -> Iterator[Row]:
    address = f'{file.resolve().as_uri()}{"?immutable=1" if immutable else ""}'
    with closing(sqlite3.connect(address, uri=True)) as base:
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
