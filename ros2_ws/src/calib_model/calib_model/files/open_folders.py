# SPDX-License-Identifier: Apache-2.0
"""Where a service may read and write: whoever can call it is on the network, not at the keyboard.

Paths are followed to where they really lead, symbolic links and `..` included, before they are
held against the folders that the node's owner has opened.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib_model.errors import CalibrationError


class NotPermittedError(CalibrationError):
    """A path outside the folders that were opened to callers."""


def usual_writing() -> tuple[str, ...]:
    """Where nodes write unless told otherwise: their working folder and the temporary one."""
    return str(Path.cwd()), tempfile.gettempdir()


def usual_reading() -> tuple[str, ...]:
    """Where nodes read unless told otherwise: there, and in the user's own folder."""
    return (*usual_writing(), str(Path.home()))


@dataclass(frozen=True)
class Folders:
    """Folders opened to callers; `parameter` is what the owner sets them by."""

    parameter: str
    folders: tuple[str, ...]

    def permit(self, path: str | Path) -> None:
        """Nothing, when `path` and, for a folder, each entry of it lead into an open folder.

        Raises:
            NotPermittedError: one leads elsewhere.
        """
        for place in (Path(path), *_entries(Path(path))):
            if not self._open(place):
                raise NotPermittedError(
                    f'{place}: outside the folders open to callers (parameter '
                    f"'{self.parameter}': {', '.join(self.folders)})"
                )

    def permit_all(self, paths: Sequence[str | Path]) -> None:
        """`permit` each path that is not empty."""
        for path in paths:
            if str(path):
                self.permit(path)

    def _open(self, path: Path) -> bool:
        try:
            leads_to = path.resolve()
            return any(leads_to.is_relative_to(Path(one).resolve()) for one in self.folders)
        except (OSError, RuntimeError, ValueError):  # links in a circle, a name too long
            return False


def _entries(folder: Path) -> Iterator[Path]:
    try:
        yield from folder.iterdir()
    except (OSError, ValueError):
        return  # a file, or nothing: whoever opens it says so
