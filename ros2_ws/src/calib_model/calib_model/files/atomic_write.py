# SPDX-License-Identifier: Apache-2.0
"""Files that are there whole or not at all, and outputs that must not be there yet."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Mapping
from pathlib import Path
from threading import get_native_id

from calib_model.errors import BagError

TAKEN = '{}: exists already, a bag is never overwritten'


def refuse_taken(path: str | Path) -> None:
    """Nothing, while a bag can be made at `path`.

    Raises:
        BagError: there is something, be it a link that leads nowhere.
    """
    if os.path.lexists(path):
        raise BagError(TAKEN.format(path))


def write_whole(path: str | Path, text: str | bytes) -> None:
    """Write a text file (UTF-8, or the bytes given) whole or not at all.

    Raises:
        OSError: it could not be written; what was there before is still there.
    """
    path = Path(path)
    write_together(path.parent, {path.name: text})


def write_together(folder: Path, texts: Mapping[str, str | bytes]) -> None:
    """Write files that belong together: none takes its place before all are on disk.

    Raises:
        OSError: one could not be written, or a device, a pipe or a folder has its name; what was
            there before is still there.
    """
    for name in texts:
        _refuse_other_than_a_file(folder / name)
    own = f'{os.getpid()}-{get_native_id()}'  # two requests may write to one folder at once
    parts = {name: folder / f'.{name}.{own}.part' for name in texts}
    try:
        for name, text in texts.items():
            with parts[name].open('wb') as stream:
                stream.write(_encoded(text) if isinstance(text, str) else text)
                stream.flush()
                os.fsync(stream.fileno())
        for name, part in parts.items():
            part.replace(folder / name)
    finally:
        for part in parts.values():
            part.unlink(missing_ok=True)


def _refuse_other_than_a_file(path: Path) -> None:
    """A new file takes the place of what has its name: for root that could be /dev/null itself."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
    except OSError:
        return  # nothing there, or a link that leads nowhere
    if not regular or os.path.realpath(path.parent) in ('/dev', '/proc/self/fd'):
        raise OSError(errno.EINVAL, 'not a regular file')


def _encoded(text: str) -> bytes:
    """UTF-8; names of files that are no text are spelled out."""
    return text.encode('utf-8', 'backslashreplace')
