# SPDX-License-Identifier: Apache-2.0
"""One line of a check."""

from __future__ import annotations

from dataclasses import dataclass

OK, DOUBTFUL, WRONG = 'ok', 'doubtful', 'wrong'


@dataclass(frozen=True)
class Finding:
    """`verdict` on `what` was looked at, what was seen, and what to do where it is not ok;
    `movable`: whether the arm may be moved a little although it is wrong."""

    what: str
    verdict: str
    seen: str
    advice: str = ''
    movable: bool = False

    def line(self) -> str:
        """The line that is printed."""
        advice = f': {self.advice}' if self.advice else ''
        return f'{self.verdict:8}  {self.what}: {self.seen}{advice}'
