# SPDX-License-Identifier: Apache-2.0
"""What callers of the services may reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib_model.files import Folders, NotPermittedError
from calib_solver.calibration import bag_list


@dataclass(frozen=True)
class Opened:
    """What callers may reach: folders to read from and to write to, Dask schedulers to name."""

    reading: Folders
    writing: Folders
    schedulers: tuple[str, ...]

    def permit(self, reads: Sequence[str], writes: str, scheduler: str = '') -> None:
        """Nothing, when all of it is open.

        Raises:
            NotPermittedError: something is not.
        """
        self.reading.permit_all([path for text in reads for path in bag_list(text)])
        self.writing.permit_all([writes])
        if scheduler and scheduler not in self.schedulers:
            raise NotPermittedError(
                f"scheduler {scheduler}: not among those open to callers (parameter 'schedulers')"
            )
