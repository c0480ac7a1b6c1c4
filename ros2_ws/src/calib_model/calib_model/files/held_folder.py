# SPDX-License-Identifier: Apache-2.0
"""Folders and files that are opened once, by descriptors: what is done with them is done with
them, whatever their names lead to by then."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from threading import get_native_id
from typing import IO

from calib_model.files.open_folders import FOLDER, OTHERS, is_others, reach
from calib_model.starting import held_back

# a pipe that nobody writes to would be waited for
_READ = os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW
IRREGULAR = 'not a regular file'


def open_file(path: str | Path) -> IO[bytes]:
    """A file to read, never a device or a pipe.

    Raises:
        OSError: it cannot be read, or is no file; `strerror` says which.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """
    within = reach()
    try:
        if within is None:
            _refuse_irregular(os.stat(path))
            return _regular(os.open(path, _READ))
        root, way = within.reading.leads_to(path)
        if not way.parts:
            raise OSError(errno.EISDIR, 'Is a directory', str(path))
        held = within.reading.folder(root / way.parent)
        try:
            found = os.stat(way.name, dir_fd=held, follow_symlinks=False)
            _refuse_irregular(found)
            if is_others(os.fstat(held), found):
                raise PermissionError(errno.EACCES, OTHERS)
            return _regular(os.open(way.name, _READ | os.O_NOFOLLOW, dir_fd=held))
        finally:
            os.close(held)
    except ValueError as error:  # a zero byte in its name
        raise OSError(errno.EINVAL, 'no name of a file') from error


def _refuse_irregular(found: os.stat_result) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise OSError(errno.EISDIR, 'Is a directory')
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, IRREGULAR)


def _regular(descriptor: int) -> IO[bytes]:
    try:
        _refuse_irregular(os.fstat(descriptor))
        return os.fdopen(descriptor, 'rb')
    except OSError:
        os.close(descriptor)
        raise


def is_there(path: str | Path, writing: bool = False) -> bool:
    """Whether there is something that `path` leads to, where this thread may read, or write."""
    path = Path(path)
    try:
        within = reach()
        if within is None:
            return path.exists()
        root, way = (within.writing if writing else within.reading).leads_to(path)
        if not way.parts:  # what the owner opened
            return root.exists()
        with HeldFolder(path.parent, writing) as folder:
            return folder.has(path.name)
    except (OSError, ValueError):
        return False


class HeldFolder:
    """A folder, opened once; `make` it and those above it where they are not there yet.

    Raises:
        OSError: there is no such folder, or it cannot be opened or made.
        NotPermittedError: it leads out of the folders that this thread is confined to.
    """

    def __init__(self, path: str | Path, writing: bool = False, make: bool = False) -> None:
        self.path = Path(path)
        within = reach()
        try:
            if within is not None:
                allowed = within.writing if writing or make else within.reading
                self.descriptor = allowed.folder(path, make)
                return
            if make:
                with suppress(FileExistsError):  # a file: opening says so
                    self.path.mkdir(parents=True, exist_ok=True)
            self.descriptor = os.open(path, FOLDER)
        except ValueError as error:  # a zero byte in its name
            raise OSError(errno.EINVAL, 'no name of a folder') from error

    @classmethod
    def below(cls, above: HeldFolder, name: str) -> HeldFolder:
        """A folder in a held one; no link is followed."""
        held = cls.__new__(cls)
        held.path = above.path / name
        held.descriptor = os.open(name, FOLDER | os.O_NOFOLLOW, dir_fd=above.descriptor)
        return held

    @classmethod
    def new(cls, path: Path) -> HeldFolder:
        """A folder that is made; those above it are made where they are not there yet.

        Raises:
            FileExistsError: there is something at `path`.
            OSError: it cannot be made.
            NotPermittedError: it leads out of the folders that this thread is confined to.
        """
        if not path.name:
            raise FileExistsError(errno.EEXIST, 'File exists')
        with cls(path.parent, make=True) as above:
            os.mkdir(path.name, dir_fd=above.descriptor)
            return cls.below(above, path.name)

    @classmethod
    def temporary(cls) -> HeldFolder:
        """The temporary folder, where this process has its copies."""
        import tempfile  # few need it

        held = cls.__new__(cls)
        held.path = Path(tempfile.gettempdir())
        held.descriptor = os.open(held.path, FOLDER)
        return held

    @property
    def current(self) -> bool:
        """Whether its name still leads to it."""
        try:
            return os.path.samestat(os.stat(self.path), os.fstat(self.descriptor))
        except (OSError, ValueError):
            return False

    def names(self) -> list[str]:
        """What is in it."""
        return os.listdir(self.descriptor)

    def stat(self, name: str) -> os.stat_result | None:
        """What an entry is; None: nothing. A link is what it leads to, unless this thread is
        confined."""
        with suppress(OSError):
            links = reach() is None
            return os.stat(name, dir_fd=self.descriptor, follow_symlinks=links)
        return None

    def has(self, name: str) -> bool:
        """Whether there is such an entry, and not just a link to nowhere."""
        return self.stat(name) is not None

    def new_file(self, name: str) -> IO[bytes]:
        """A new file to write.

        Raises:
            OSError: there is something of that name, or it cannot be made.
        """
        return os.fdopen(os.open(name, _NEW, 0o666, dir_fd=self.descriptor), 'wb')

    def open_to_change(self, name: str) -> IO[bytes]:
        """A file that is there, to write to it."""
        flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
        return os.fdopen(os.open(name, flags, dir_fd=self.descriptor), 'r+b')

    def put(self, content: bytes, name: str) -> IO[bytes]:
        """Write a new file and put it on disk; it comes back open, and locked: it is at work."""
        stream = self.new_file(name)
        with suppress(OSError):  # a file system without locks
            fcntl.flock(stream.fileno(), fcntl.LOCK_EX)
        try:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        except BaseException:
            with suppress(OSError):
                stream.close()
            self.remove(name)
            raise
        return stream

    @held_back()
    def write_together(self, texts: Mapping[str, bytes]) -> None:
        """Write files that belong together: none takes its place before all are on disk. What one
        that was killed left of them is removed.

        Raises:
            OSError: one could not be written, or a device, a pipe or a folder has its name; what
                was there before is still there.
        """
        for name in texts:
            self.refuse_other_than_a_file(name)
        self.remove_dead_parts(texts)
        parts = {name: part_name(name) for name in texts}
        open_parts: list[IO[bytes]] = []
        try:
            for name, text in texts.items():
                open_parts.append(self.put(text, parts[name]))
            for name, part in parts.items():
                os.replace(part, name, src_dir_fd=self.descriptor, dst_dir_fd=self.descriptor)
        finally:
            for part in parts.values():
                self.remove(part)
            for stream in open_parts:
                stream.close()

    def refuse_unwritable(self) -> None:
        """Nothing, when files can be made here, as far as the file system can be asked: by one
        without a name, that a kill does not leave behind.

        Raises:
            OSError: says why not.
        """
        try:
            os.close(os.open('.', os.O_TMPFILE | os.O_WRONLY, 0o600, dir_fd=self.descriptor))
        except OSError as error:
            if error.errno not in (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL):
                raise

    def refuse_other_than_a_file(self, name: str) -> None:
        """A new file takes the place of what has its name: for root that could be /dev/null itself.

        Raises:
            OSError: it is no file.
        """
        there = self.stat(name)  # None, too, for a link that leads nowhere
        if there is None:
            return
        taken = stat.S_ISREG(there.st_mode) or stat.S_ISLNK(there.st_mode)
        if not taken or os.path.realpath(self.path) in ('/dev', '/proc/self/fd'):
            raise OSError(errno.EINVAL, IRREGULAR)

    def remove(self, name: str) -> None:
        """Take a file away, if it is there."""
        with suppress(FileNotFoundError):
            os.unlink(name, dir_fd=self.descriptor)

    def remove_tree(self, name: str) -> None:
        """Take a folder away with all that is in it; no link is followed.

        Raises:
            OSError: it cannot be taken away.
        """
        import shutil  # few need it

        # no dir_fd before Python 3.11; what is below is gone through by descriptors
        shutil.rmtree(f'/proc/self/fd/{self.descriptor}/{name}')

    def remove_dead_parts(self, names: Collection[str]) -> None:
        """Take away what writers of these files left who were killed: nobody holds it any more."""
        for entry in self.names():
            name = whole_name(entry)
            if name is not None and name in names:
                with suppress(OSError):  # gone by itself, or another user's
                    self._remove_if_dead(entry)

    def _remove_if_dead(self, entry: str) -> None:
        held = os.open(entry, _READ | os.O_NOFOLLOW, dir_fd=self.descriptor)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(entry, dir_fd=self.descriptor)
        finally:
            os.close(held)

    def close(self) -> None:
        """Let it go; further calls do nothing."""
        held, self.descriptor = self.descriptor, -1
        if held >= 0:
            os.close(held)

    def __enter__(self) -> HeldFolder:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def part_name(name: str) -> str:
    """What a file is called while it is written: two requests may write to one folder at once."""
    return f'.{name}.{os.getpid()}-{get_native_id()}.part'


def whole_name(part: str) -> str | None:
    """The name that `part_name` made this of; None: it did not."""
    if not (part.startswith('.') and part.endswith('.part')):
        return None
    name, _, own = part[1 : -len('.part')].rpartition('.')
    return name if name and own.replace('-', '').isdecimal() else None
