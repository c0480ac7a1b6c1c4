# SPDX-License-Identifier: Apache-2.0
"""Reading a file that a user or a caller names: whatever it turns out to be, no harm is done."""

from __future__ import annotations

import errno
from pathlib import Path

from calib_model.files.held_folder import open_file

LARGEST_FILE = 256 * 1024 * 1024  # bytes: a table of a million rows has half of that


def file_content(path: str | Path, largest: int = LARGEST_FILE) -> bytes:
    """The bytes of a file.

    Raises:
        OSError: it cannot be read, is no file (a folder, a device, a pipe), or has more than
            `largest` bytes; `strerror` says which.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    with open_file(path) as stream:
        content = stream.read(largest + 1)
    if len(content) > largest:
        raise OSError(errno.EFBIG, f'larger than {largest} bytes')
    return content
