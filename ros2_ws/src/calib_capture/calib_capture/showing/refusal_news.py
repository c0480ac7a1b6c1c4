# SPDX-License-Identifier: Apache-2.0
"""Refused poses, told while there is still time to do something about it."""

from __future__ import annotations

from calib_capture.measuring import Tally


class RefusalNews:
    """Tells of each reason when it first comes up; what comes after is counted."""

    def __init__(self) -> None:
        self._told: set[str] = set()

    def of(self, tally: Tally) -> list[str]:
        """A line for each new reason, with where it was."""
        if len(self._told) == len(tally.refused):
            return []
        new = {
            reason: (location, sphere)
            for location, sphere, reason in reversed(tally.refused_at)
            if reason not in self._told
        }
        self._told.update(new)
        return [
            f'location {location}, sphere {sphere}: a pose is refused, {reason} (said once; '
            'all are counted)'
            for reason, (location, sphere) in reversed(new.items())
        ]
