# SPDX-License-Identifier: Apache-2.0
"""The files of a bag in recorded order, and opening them whatever rosbag2 wrapped them in."""

from __future__ import annotations

import errno
import os
import re
from collections import Counter
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import zstandard

from calib_model.errors import BagError, DescriptionError
from calib_model.files import HeldFolder, file_content, load_plain, open_file

ZSTD = b'\x28\xb5\x2f\xfd'
SQLITE = b'SQLite format 3\x00'
METADATA = 'metadata.yaml'
NO_METADATA = 'not a rosbag2 metadata file'
LARGEST_METADATA = 20_000_000  # characters: of some hundred thousand files
NOWHERE = (errno.ENOENT, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP)
KINDS = ('.mcap', '.db3')


def bag_files(path: str | Path) -> list[Path]:
    """The storage files of a bag: of its folder in recorded order, or the file itself.

    Raises:
        BagError: there is no bag at `path`, or one of its files is a pipe or a device.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    path = Path(path)
    there = _names(path)
    if there is None:
        size_of(path)
        return [path]
    found = _listed_files(path, there) or unlisted_files(path)
    if not found:
        raise BagError(f'{path}: no .mcap file in this folder')
    for file in found:
        if file.name not in there:
            raise BagError(f'{path}: metadata.yaml names {file.name}, which is missing')
        size_of(file)
    return found


def size_of(file: Path) -> int:
    """Bytes of a file of a bag.

    Raises:
        BagError: it cannot be read, or is no file.
    """
    try:
        with open_file(file) as stream:
            return os.fstat(stream.fileno()).st_size
    except OSError as error:
        if error.errno in NOWHERE:
            raise BagError(f'{file}: no such bag') from error
        raise BagError(f'{file}: cannot be read: {error.strerror}') from error


def _names(folder: Path) -> set[str] | None:
    """What is in a folder; None: it is a file, or there is nothing."""
    try:
        with HeldFolder(folder) as held:
            return set(held.names())
    except OSError:
        return None


def files_in(folder: Path, kind: str = '.mcap') -> list[Path]:
    """The files of a folder in recorded order, whatever its metadata.yaml says."""
    names = _names(folder) or set()
    return sorted((folder / name for name in names if name.endswith(kind)), key=_recorded)


def _recorded(file: Path) -> list[int | str]:
    parts = re.split(r'(\d+)', file.name)  # rosbag2 counts: _9 comes before _10
    return [int(part) if part.isdecimal() else part for part in parts]


def unlisted_files(folder: Path) -> list[Path]:
    """The files that a folder's metadata.yaml does not list: those of a recording stopped hard.

    rosbag2 compresses a file when it begins the next one, so the last may be as it was written.
    """
    for kind in KINDS:
        plain = files_in(folder, kind)
        known = set(plain)
        packed = [
            file for file in files_in(folder, f'{kind}.zstd') if file.with_suffix('') not in known
        ]
        if plain or packed:
            return sorted([*plain, *packed], key=_recorded)
    return []


def left_aside(path: str | Path) -> list[Path]:
    """Files of a bag's folder that its metadata.yaml does not list, and that are not read.

    Raises:
        BagError: there is no bag at `path`.
    """
    listed = bag_files(path)
    if listed == [Path(path)]:
        return []
    known = {_plain(file) for file in listed}
    return [file for file in unlisted_files(Path(path)) if _plain(file) not in known]


def _plain(file: Path) -> Path:
    """The name that a file has where rosbag2 did not compress it."""
    return file.with_suffix('') if file.suffix == '.zstd' else file


def _listed_files(folder: Path, there: set[str]) -> list[Path]:
    information = _information(folder) if METADATA in there else {}
    try:
        names = information['relative_file_paths'] if information else []
        files = [Path(name).name for name in names]
    except (TypeError, KeyError) as error:
        raise BagError(f'{folder / METADATA}: {NO_METADATA}') from error
    # a recording that was stopped hard: files are compressed, their list was not written anew
    packed = [name not in there and f'{name}.zstd' in there for name in files]
    listed = [
        folder / (f'{name}.zstd' if pack else name)
        for name, pack in zip(files, packed, strict=True)
    ]
    twice = [file for file, count in Counter(listed).items() if count > 1]
    if twice:
        raise BagError(f'{folder / METADATA}: lists {twice[0].name} twice')
    return listed


def _information(folder: Path) -> dict[str, Any]:
    """What metadata.yaml says; empty where there is none."""
    metadata = folder / METADATA
    try:
        return _parsed(file_content(metadata, 4 * LARGEST_METADATA).decode('utf-8'))
    except (FileNotFoundError, NotADirectoryError):
        return {}
    except DescriptionError as error:
        raise BagError(f'{metadata}: {error}') from error
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise BagError(f'{metadata}: {NO_METADATA}') from error


@lru_cache(maxsize=8)
def _parsed(text: str) -> dict[str, Any]:
    """The content of a metadata.yaml, which a command asks for several times and a parser in
    Python is slow at."""
    return dict(load_plain(text, NO_METADATA, LARGEST_METADATA)['rosbag2_bagfile_information'])


def listed_topics(path: str | Path) -> dict[str, str]:
    """Topics with messages and their types, as far as metadata.yaml tells; empty where it does not.

    Raises:
        BagError: there is no bag at `path`.
    """
    bag_files(path)
    try:
        rows = _information(Path(path))['topics_with_message_count']
        return {
            str(row['topic_metadata']['name']): str(row['topic_metadata']['type'])
            for row in rows
            if int(row['message_count']) > 0
        }
    except (TypeError, KeyError, ValueError):
        return {}


def begins_with(file: Path, magic: bytes) -> bool:
    """Whether a file starts with these bytes.

    Raises:
        OSError: it cannot be read.
    """
    with open_file(file) as stream:
        return stream.read(len(magic)) == magic


def open_unpacked(file: Path, packed: IO[bytes] | None = None) -> IO[bytes]:
    """A file's content from its begin on, without the zstd that rosbag2 put around it, if any.

    `packed` is the file where it is open already, to see how far the reading is.

    Raises:
        OSError: it cannot be read; later reads raise zstandard.ZstdError where it is damaged.
    """
    stream = packed or open_file(file)
    if not begins_with(file, ZSTD):
        return stream
    unpacked: IO[bytes] = zstandard.ZstdDecompressor().stream_reader(
        stream, read_across_frames=True
    )
    return unpacked


def is_sqlite(file: Path) -> bool:
    """Whether a file is an SQLite one, or the packing of one by name."""
    packed = file.name.endswith('.db3.zstd') and begins_with(file, ZSTD)
    return packed or begins_with(file, SQLITE)
