# SPDX-License-Identifier: Apache-2.0
"""Where a service may read and write: whoever can call it is on the network, not at the keyboard.

Paths are followed to where they really lead, symbolic links and `..` included, and held against the
folders that the node's owner has opened. Then the way there is gone again from the open folder's
descriptor, folder by folder, and no link is followed: one that was put there after the first look
leads nowhere.
"""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from calib_model.errors import CalibrationError

FOLDER = os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC
#: a folder on the way: to go through it one need not be allowed to list it
_PASSED = getattr(os, 'O_PATH', os.O_RDONLY) | os.O_DIRECTORY | os.O_CLOEXEC


OTHERS = 'everybody may write in the folder that it is in, and it is not your own'


class NotPermittedError(CalibrationError):
    """A path outside the folders that were opened to callers."""


def usual_writing() -> tuple[str, ...]:
    """Where nodes write unless told otherwise: their working folder and the temporary one."""
    import tempfile  # few need it

    return str(Path.cwd()), tempfile.gettempdir()


def usual_reading() -> tuple[str, ...]:
    """Where nodes read unless told otherwise: there, and in the user's own folder."""
    return (*usual_writing(), str(Path.home()))


@dataclass(frozen=True)
class Folders:
    """Folders opened to callers; `parameter` is what the owner sets them by.

    Of one where everybody may write, as /tmp, only what is the user's own in it is open.
    """

    parameter: str
    folders: tuple[str, ...]

    def permit(self, path: str | Path) -> None:
        """Nothing, when `path` and, for a folder, each entry of it lead into an open folder.

        Raises:
            NotPermittedError: one leads elsewhere.
        """
        for place in (Path(path), *_entries(Path(path))):
            self.leads_to(place)

    def permit_all(self, paths: Sequence[str | Path]) -> None:
        """`permit` each path that is not empty."""
        for path in dict.fromkeys(map(str, paths)):
            if path:
                self.permit(path)

    def leads_to(self, path: str | Path) -> tuple[Path, Path]:
        """The open folder that a path leads into, and the way from there, without a link.

        Raises:
            NotPermittedError: it leads elsewhere.
        """
        with suppress(OSError, RuntimeError, ValueError):  # links in a circle, a name too long
            real = Path(path).resolve()
            for one in self.folders:
                root = Path(one).resolve()
                if real.is_relative_to(root) and not _others(root, real):
                    return root, real.relative_to(root)
        raise NotPermittedError(
            f'{path}: outside the folders open to callers (parameter '
            f"'{self.parameter}': {', '.join(self.folders)})"
        )

    def folder(self, path: str | Path, make: bool = False) -> int:
        """A descriptor of the folder at `path`, which is made where it is not there yet.

        Raises:
            NotPermittedError: it leads elsewhere.
            OSError: no such folder, or there is a link now where there was none, or its name is
                longer than one can be.
        """
        root, way = self.leads_to(path)
        refuse_too_long(root / way)
        if make:
            root.mkdir(parents=True, exist_ok=True)
        held = os.open(root, FOLDER if not way.parts else _PASSED)
        for number, name in enumerate(way.parts, start=1):
            try:
                if make:
                    with suppress(FileExistsError):
                        os.mkdir(name, dir_fd=held)
                kind = FOLDER if number == len(way.parts) else _PASSED
                below = os.open(name, kind | os.O_NOFOLLOW, dir_fd=held)
                if number == 1 and is_others(os.fstat(held), os.fstat(below)):
                    os.close(below)
                    raise PermissionError(errno.EACCES, OTHERS)
            finally:
                os.close(held)
            held = below
        return held


@dataclass(frozen=True)
class Reach:
    """What may be read and what may be written."""

    reading: Folders
    writing: Folders


_reach: ContextVar[Reach | None] = ContextVar('reach', default=None)


@contextmanager
def confined(reading: Folders, writing: Folders) -> Iterator[None]:
    """Within, this thread's files are opened in these folders alone, whatever names lead to by
    then: those that this room opens."""
    before = _reach.set(Reach(reading, writing))
    try:
        yield
    finally:
        _reach.reset(before)


def reach() -> Reach | None:
    """What this thread may read and write; None: what its user may."""
    return _reach.get()


def refuse_too_long(path: Path) -> None:
    """Nothing, where a path can be opened by its whole name. Folder by folder a deeper one could be
    made, which few programs could remove.

    Raises:
        OSError: it is too long.
    """
    if len(os.fsencode(path)) >= os.pathconf('/', 'PC_PATH_MAX'):
        raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))


def is_others(shared: os.stat_result, entry: os.stat_result) -> bool:
    """Whether an entry of a folder in which everybody may write is not the user's own."""
    if not shared.st_mode & stat.S_IWOTH:
        return False
    return entry.st_uid != os.geteuid() or bool(entry.st_mode & stat.S_IWOTH)


def _others(root: Path, real: Path) -> bool:
    way = real.relative_to(root)
    try:
        return bool(way.parts) and is_others(root.stat(), (root / way.parts[0]).lstat())
    except OSError:
        return False  # it is to be made, or nobody can


def _entries(folder: Path) -> Iterator[Path]:
    try:
        yield from folder.iterdir()
    except (OSError, ValueError):
        return  # a file, or nothing: whoever opens it says so
