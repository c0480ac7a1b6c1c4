# SPDX-License-Identifier: Apache-2.0
"""Files that are there whole or not at all, and outputs that must not be there yet."""

from __future__ import annotations

import os
from pathlib import Path

from calib_model.errors import BagError
from calib_model.files.held_folder import HeldFolder

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
        OSError: it could not be written, or a device, a pipe or a folder has its name; what was
            there before is still there.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    path = Path(path)
    with HeldFolder(path.parent, writing=True) as folder:
        folder.write_together({path.name: encoded(text)})


def encoded(text: str | bytes) -> bytes:
    """UTF-8; names of files that are no text are spelled out."""
    return text.encode('utf-8', 'backslashreplace') if isinstance(text, str) else text
