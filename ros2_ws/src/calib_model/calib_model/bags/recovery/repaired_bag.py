# SPDX-License-Identifier: Apache-2.0
"""Making the files of a recording that was cut short complete where they stand."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from calib_model.bags.files import METADATA, files_in, size_of
from calib_model.bags.metadata import FileAccount, metadata_yaml
from calib_model.bags.recovery.whole_messages import Recovery, copy_whole
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError
from calib_model.files import HeldFolder, remove_dead_folders, working_folder

UNBEGUN = 1 << 16  # bytes: a recording's first chunk, the descriptions, is smaller


def repair(bag: str | Path, told: Callable[[str], None] = lambda line: None) -> list[FileAccount]:
    """Make every file of a bag's folder complete, in its place; what each then holds.

    `told` gets a line for each file that was not complete.

    A file is exchanged for its recovered copy in one step, so that a repair cut short does no
    harm. Files that are complete stay as they are. One that was cut before its first chunk is
    taken away, and with the last of them the folder.

    Raises:
        BagError: no bag there, nothing in a file that once held something, or the bag cannot be
            written.
    """
    folder = Path(bag)
    try:
        with HeldFolder(folder, writing=True) as held:
            return _repaired_in(held, told)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise BagError(f'{folder}: no such bag') from error
    except OSError as error:
        raise BagError(f'{folder}: cannot be written: {error.strerror}') from error


def _repaired_in(held: HeldFolder, told: Callable[[str], None]) -> list[FileAccount]:
    files = files_in(held.path)
    if not files and not held.has(METADATA):
        raise BagError(f'{held.path}: no such bag')
    held.remove_dead_parts((METADATA,))
    remove_dead_folders(held, 'repair')
    for name in held.names():
        if name.startswith('.repair-'):  # of 0.1.0
            held.remove_tree(name)
    accounts = []
    for file in files:
        account = _repaired(held, file, told)
        if account.messages:
            accounts.append(account)
        elif size_of(file) > UNBEGUN:
            raise BagError(f'{file}: no complete chunk in it, nothing can be recovered')
        else:
            held.remove(file.name)
    if accounts:
        held.write_together({METADATA: metadata_yaml(accounts).encode()})
        return accounts
    held.remove(METADATA)
    if not held.names() and held.current:
        held.path.rmdir()
    return accounts


def _repaired(held: HeldFolder, file: Path, told: Callable[[str], None]) -> FileAccount:
    with working_folder(held, 'repair') as part:
        found, copy = Recovery(), BagWriter(part.path / 'copy')
        with copy:
            copy_whole(file, copy, found)
        account = copy.close()
        if found.lossy:
            told(f'{file}: {found.messages} messages recovered, missing: {found.loss()}')
        if found.lossy and found.messages:
            with HeldFolder.below(part, 'copy') as made:
                os.replace(
                    account.name,
                    file.name,
                    src_dir_fd=made.descriptor,
                    dst_dir_fd=held.descriptor,
                )
    account.name = file.name
    return account
