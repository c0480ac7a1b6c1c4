# SPDX-License-Identifier: Apache-2.0
"""One writer at a time for a folder, on this machine: a lock ends with the process that has it."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from types import TracebackType


class FolderLock:
    """Holds a folder from `take` to `release`, against other processes and threads of this one.

    Where the file system knows no locks, everybody gets it.
    """

    def __init__(self, folder: str | Path) -> None:
        self._folder = Path(folder)
        self._held = -1

    def take(self, wait: bool = False) -> bool:
        """Whether the folder is ours now; False: somebody else holds it, and we did not `wait`.

        Raises:
            OSError: there is no such folder, or it cannot be opened.
        """
        held = os.open(self._folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            fcntl.flock(held, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            os.close(held)
            return False
        except OSError:  # a file system without locks
            os.close(held)
            return True
        self._held = held
        return True

    def release(self) -> None:
        """Let others have it; further calls do nothing."""
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def __enter__(self) -> FolderLock:
        self.take(wait=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()
