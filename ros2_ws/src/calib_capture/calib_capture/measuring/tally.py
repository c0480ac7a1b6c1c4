# SPDX-License-Identifier: Apache-2.0
"""How a run is going, in counts."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from calib_model.pairing import reasons_in_words


@dataclass
class Tally:
    """Poses planned, taken and refused so far; of the refused, so many were `replaced` by spares.

    `refused` counts by reason, `refused_at` by location, sphere and reason; `tried_again` what was
    in vain and is tried once more.
    """

    planned: int
    taken: int = 0
    replaced: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    refused_at: Counter[tuple[int, int, str]] = field(default_factory=Counter)
    tried_again: Counter[str] = field(default_factory=Counter)

    @property
    def left(self) -> int:
        """Of the planned poses, those that are still to be tried."""
        return max(self.planned - self.done, 0)

    @property
    def done(self) -> int:
        """Of the planned poses, those that need no more attention."""
        return self.taken + sum(self.refused.values()) - self.replaced

    def refuse(self, location: int, sphere: int, reason: str, replaced: bool) -> None:
        """Count a pose as refused; another one is tried in its place if it is `replaced`."""
        self.refused[reason] += 1
        self.refused_at[location, sphere, reason] += 1
        self.replaced += replaced

    def line(self) -> str:
        """Counts in words."""
        why = (
            f' ({reasons_in_words(self.refused)}; {self.replaced} replaced)' if self.refused else ''
        )
        return f'{self.taken} poses taken, {sum(self.refused.values())} refused{why}'

    def so_far(self) -> str:
        """The same in a few words, while there is more to come."""
        why = f' ({reasons_in_words(self.refused)})' if self.refused else ''
        refused = sum(self.refused.values())
        return f'{self.taken} taken, {refused} refused{why}, {self.left} to go'
