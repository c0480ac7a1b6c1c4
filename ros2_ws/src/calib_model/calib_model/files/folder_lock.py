# SPDX-License-Identifier: Apache-2.0
"""One writer at a time for a folder, on this machine: a lock ends with the process that has it."""

from __future__ import annotations

import fcntl
from pathlib import Path

from calib_model.files.held_folder import HeldFolder


class FolderLock:
    """Holds a folder from `take` to `release`, against other processes and threads of this one.

    Where the file system knows no locks, everybody gets it.
    """

    def __init__(self, folder: str | Path, writing: bool = False) -> None:
        self._path = Path(folder)
        self._writing = writing
        self._held: HeldFolder | None = None

    @property
    def folder(self) -> HeldFolder:
        """The folder, from `take` to `release`."""
        assert self._held is not None
        return self._held

    def take(self, wait: bool = False) -> bool:
        """Whether the folder is ours now; False: somebody else holds it, and we did not `wait`.

        Raises:
            OSError: there is no such folder, or it cannot be opened.
        """
        while True:
            held = HeldFolder(self._path, self._writing)
            try:
                fcntl.flock(held.descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
            except BlockingIOError:
                held.close()
                return False
            except OSError:  # a file system without locks
                break
            if held.current:
                break
            held.close()  # while we waited another folder took its name
        self._held = held
        return True

    def release(self) -> None:
        """Let others have it; further calls do nothing."""
        if self._held is not None:
            self._held.close()
            self._held = None

    def __enter__(self) -> FolderLock:
        self.take(wait=True)
        return self

    def __exit__(self, *_: object) -> None:
        self.release()
