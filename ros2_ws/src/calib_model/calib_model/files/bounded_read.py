# SPDX-License-Identifier: Apache-2.0
"""Reading a file that a user or a caller names: whatever it turns out to be, no harm is done."""

from __future__ import annotations

import errno
from pathlib import Path

LARGEST_FILE = 256 * 1024 * 1024  # bytes: a table of a million rows has half of that


def file_content(path: str | Path, largest: int = LARGEST_FILE) -> bytes:
    """The bytes of a file.

    Raises:
        OSError: it cannot be read, is no file (a folder, a device, a pipe that nobody writes to),
            or has more than `largest` bytes; `strerror` says which.
    """
    path = Path(path)
    try:
        if path.exists() and not path.is_dir() and not path.is_file():
            raise OSError(errno.EINVAL, 'not a regular file')
        with path.open('rb') as stream:
            content = stream.read(largest + 1)
    except ValueError as error:  # a zero byte in its name
        raise OSError(errno.EINVAL, 'no name of a file') from error
    if len(content) > largest:
        raise OSError(errno.EFBIG, f'larger than {largest} bytes')
    return content
