# SPDX-License-Identifier: Apache-2.0
"""Folders that appear whole or not at all, and sets of files that are replaced in one step.

A new folder is filled beside the old one and exchanged for it, by one call to the kernel. What
users keep in the old one goes along. A kill leaves the old set or the new one; what else it leaves,
a folder `.NAME.PID-THREAD.part`, the next writer removes.
"""

from __future__ import annotations

import fcntl
import os
import stat
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from calib_model.errors import BagError
from calib_model.files.folder_lock import FolderLock
from calib_model.files.held_folder import HeldFolder, is_there, part_name, whole_name
from calib_model.files.open_folders import NotPermittedError, refuse_too_long
from calib_model.starting import held_back

_EXCHANGE = 2  # RENAME_EXCHANGE of renameat2(2)


@contextmanager
def made_whole(path: str | Path) -> Iterator[Path]:
    """A name for a folder to be made, in a place of its own; at the end it becomes `path`, which
    must not be there. What one that was killed left is removed.

    Raises:
        BagError: it, or something in it, cannot be written.
    """
    path = Path(path)
    try:
        with (
            HeldFolder(path.parent, make=True) as above,
            working_folder(above, path.name) as part,
        ):
            place = part.path / path.name
            yield place
            place.rename(path)
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror}') from error


@contextmanager
def working_folder(
    above: HeldFolder, name: str, known: Collection[str] = (), mode: int = 0o777
) -> Iterator[HeldFolder]:
    """A folder for what is to become `name`, taken away at the end if it is still there; those of
    the dead, too.

    Raises:
        OSError: it cannot be made.
    """
    remove_dead_folders(above, name, known)
    part = None
    try:
        with held_back():
            part = _new_part(above, part_name(name), mode)
        yield part
    finally:
        with held_back():
            if part is not None:
                if _leads_to(above, part.path.name, part):
                    above.remove_tree(part.path.name)
                part.close()


def remove_dead_folders(above: HeldFolder, name: str, known: Collection[str] = ()) -> None:
    """Take away the working folders of `name` that nobody holds any more."""
    for entry in above.names():
        if whole_name(entry) == name:
            with suppress(OSError):  # in use, or another user's
                _remove_if_dead(above, entry, name, known)


def _new_part(above: HeldFolder, entry: str, mode: int) -> HeldFolder:
    """A new folder, locked: it is at work, not dead."""
    while True:
        os.mkdir(entry, mode, dir_fd=above.descriptor)
        part = HeldFolder.below(above, entry)
        with suppress(OSError):  # a file system without locks
            fcntl.flock(part.descriptor, fcntl.LOCK_EX)
        if _leads_to(above, entry, part):
            return part
        part.close()  # taken for dead, before it was locked


def _leads_to(above: HeldFolder, entry: str, held: HeldFolder) -> bool:
    """Whether an entry is this folder, itself."""
    try:
        there = os.stat(entry, dir_fd=above.descriptor, follow_symlinks=False)
    except OSError:
        return False
    return os.path.samestat(there, os.fstat(held.descriptor))


def refuse_unwritable(path: str | Path, known: Collection[str]) -> None:
    """Nothing, when `replace_set` could write there now: to be asked before long work.

    Raises:
        OSError: it could not; nothing was made or changed.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    path = Path(os.path.realpath(path))
    refuse_too_long(path)
    above = path
    while not is_there(above, writing=True) and above != above.parent:
        above = above.parent
    with HeldFolder(above, writing=True) as held:
        held.refuse_unwritable()
        if above == path:
            for name in known:
                held.refuse_other_than_a_file(name)


@held_back()
def replace_set(path: str | Path, contents: Mapping[str, bytes], known: Collection[str]) -> None:
    """Make `contents` the files of the folder at `path`, of all the names that are `known`: those
    which have no content are taken away. Others stay as they are.

    It is one step wherever the folder can be exchanged for another: not where it is mounted, has
    folders in it, is our working folder or another user's, and not on file systems that know no
    exchange. There file after file takes its place, when all are on disk.

    Raises:
        OSError: it cannot be written.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    path = Path(os.path.realpath(path))
    known = {*known, *contents}
    if _replaced_in_one_step(path, contents, known):
        return
    HeldFolder(path, make=True).close()
    with FolderLock(path, writing=True) as lock:
        for name in known:
            lock.folder.refuse_other_than_a_file(name)
        lock.folder.write_together(contents)
        for name in known - set(contents):
            lock.folder.remove(name)


def _replaced_in_one_step(
    path: Path, contents: Mapping[str, bytes], known: Collection[str]
) -> bool:
    """Whether that could be done; what is in the way of every way is told by the other one."""
    try:
        with (
            HeldFolder(path.parent, writing=True, make=True) as above,
            working_folder(above, path.name, known) as part,
        ):
            for name, content in contents.items():
                part.put(content, name).close()
            if above.stat(path.name) is None:
                os.rename(
                    part.path.name,
                    path.name,
                    src_dir_fd=above.descriptor,
                    dst_dir_fd=above.descriptor,
                )
                return True
            return _exchanged(above, path.name, part, known)
    except (OSError, NotPermittedError):
        return False


def _exchanged(above: HeldFolder, name: str, part: HeldFolder, known: Collection[str]) -> bool:
    """Exchange `part` for the folder of that name, with what users keep there."""
    with HeldFolder.below(above, name) as old:
        if not _exchangeable(old, part):
            return False
        for entry in old.names():
            if entry in known or whole_name(entry) in known:
                continue
            if stat.S_ISDIR(os.stat(entry, dir_fd=old.descriptor, follow_symlinks=False).st_mode):
                return False
            os.link(
                entry,
                entry,
                src_dir_fd=old.descriptor,
                dst_dir_fd=part.descriptor,
                follow_symlinks=False,
            )
        for entry in known:
            part_stat = old.stat(entry)
            if part_stat is not None and not stat.S_ISREG(part_stat.st_mode):
                return False
        os.fchmod(part.descriptor, stat.S_IMODE(os.fstat(old.descriptor).st_mode))
        os.fsync(part.descriptor)
        if not _exchange(above.descriptor, part.path.name, name):
            return False
        if not _leads_to(above, part.path.name, old):
            # something else had the name by then, a link, say
            _exchange(above.descriptor, part.path.name, name)
            return False
        _retire(old, part, known)
        os.rmdir(part.path.name, dir_fd=above.descriptor)
        return True


def _exchangeable(old: HeldFolder, part: HeldFolder) -> bool:
    there, ours = os.fstat(old.descriptor), os.fstat(part.descriptor)
    alike = (there.st_uid, there.st_gid, there.st_dev) == (ours.st_uid, ours.st_gid, ours.st_dev)
    try:
        return alike and not os.path.samestat(there, os.stat('.'))
    except OSError:  # the working folder is gone
        return alike


def _exchange(above: int, one: str, other: str) -> bool:
    """Whether two names in a folder could be exchanged, in one step."""
    import ctypes  # few need it

    call = getattr(ctypes.CDLL(None, use_errno=True), 'renameat2', None)
    names = os.fsencode(one), os.fsencode(other)
    return call is not None and call(above, names[0], above, names[1], _EXCHANGE) == 0


def _retire(old: HeldFolder, current: HeldFolder, known: Collection[str]) -> None:
    """Take away what is in a folder that another has the name of now; what a user has put there
    since then goes along."""
    for entry in old.names():
        moved, there = (
            os.stat(entry, dir_fd=old.descriptor, follow_symlinks=False),
            current.stat(entry),
        )
        ours = entry in known or whole_name(entry) in known
        if ours or (there is not None and os.path.samestat(moved, there)):
            old.remove(entry)
        elif there is None:
            os.rename(entry, entry, src_dir_fd=old.descriptor, dst_dir_fd=current.descriptor)


def _remove_if_dead(above: HeldFolder, entry: str, name: str, known: Collection[str]) -> None:
    """Take a folder away that nobody holds; raises OSError where somebody does."""
    with HeldFolder.below(above, entry) as dead:
        fcntl.flock(dead.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if known and above.has(name):
            with HeldFolder.below(above, name) as current:
                _retire(dead, current, known)
            os.rmdir(entry, dir_fd=above.descriptor)
        else:
            above.remove_tree(entry)
