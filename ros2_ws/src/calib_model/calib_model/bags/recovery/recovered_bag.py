# SPDX-License-Identifier: Apache-2.0
"""Getting out of a damaged bag what is whole in it: every complete chunk."""

from __future__ import annotations

from pathlib import Path

from calib_model.bags.files import bag_files, left_aside, size_of, unlisted_files
from calib_model.bags.recovery.whole_messages import Recovery, copy_whole
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError
from calib_model.files import made_whole, refuse_taken
from calib_model.progress import Pace, Progress


def recover(bad: str | Path, out: str | Path, progress: Progress | None = None) -> Recovery:
    """Copy what is whole in the bag `bad` to a new bag `out`, made whole or not at all; `progress`
    hears how far it is.

    Raises:
        BagError: no bag at `bad`, nothing in it to be had, or `out` exists or cannot be written.
    """
    bad, out = Path(bad), Path(out)
    refuse_taken(out)
    files, found = _files_of(bad), Recovery()
    with made_whole(out) as part:
        with BagWriter(part, chunk_size=1 << 20) as bag:
            for file in files:
                pace = Pace(progress, f'copying {file}', 'MB', 1e6)
                copy_whole(file, bag, found, pace)
                pace.end()
        if not found.messages:
            raise BagError(f'{bad}: no complete chunk in it, nothing can be recovered')
    return found


def _files_of(bad: Path) -> list[Path]:
    try:
        # what metadata.yaml does not list may be the rest of a copy that was made in part
        files = [*bag_files(bad), *left_aside(bad)]
    except BagError:
        # a metadata.yaml that was not finished either: the files speak for themselves
        files = unlisted_files(bad) if bad.is_dir() else []
        if not files:
            raise
    for file in files:
        size_of(file)  # names a pipe
    return files
