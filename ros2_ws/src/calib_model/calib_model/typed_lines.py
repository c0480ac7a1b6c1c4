# SPDX-License-Identifier: Apache-2.0
"""Lines typed on a terminal while work goes on."""

from __future__ import annotations

import os
import select
import sys
import termios


class TypedLines:
    """What is typed on standard input, where that is a terminal and we are in front."""

    def __init__(self) -> None:
        self.heard = sys.stdin is not None and sys.stdin.isatty()

    def take(self) -> list[str]:
        """The lines typed since, stripped of blanks and in small letters."""
        lines = []
        while self.heard and _in_front() and select.select([sys.stdin], [], [], 0)[0]:
            line = sys.stdin.readline()
            self.heard = bool(line)  # else the terminal is gone
            lines += [line.strip().lower()] * self.heard
        return lines

    def forget(self) -> None:
        """What was typed before is no answer to what is asked now."""
        if self.heard and _in_front():
            termios.tcflush(sys.stdin, termios.TCIFLUSH)


def _in_front() -> bool:
    """Whether what is typed is for us: who reads a terminal from the background is stopped."""
    try:
        return os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except OSError:
        return False
