# SPDX-License-Identifier: Apache-2.0
"""Telling how far long work has come: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import io
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from typing import TextIO, TypeVar

T = TypeVar('T')
BAR, SHORTEST_BAR = 30, 8
COLUMNS = 80
BAR_PERIOD = 0.1  # s
LINE_PERIOD = 5.0  # s
FIRST = 0.02  # of the work
QUIET = 1.0  # s: work that is done by then need not tell of itself


class Progress:
    """Shows counts of `things`, not more often than can be read."""

    def __init__(self, stream: TextIO | None = sys.stdout, things: str = 'poses') -> None:
        # None is a stream that was closed before Python began
        stream = stream or io.StringIO()
        self._stream = stream
        self._things = things
        self._bar = stream.isatty()
        self._shown = -math.inf
        self._open = False

    def show(
        self,
        done: int,
        planned: int,
        seconds_left: float,
        where: str,
        now: float,
        things: str = '',
    ) -> None:
        """Tell of `done` out of `planned`; `now` is a clock in s."""
        period = BAR_PERIOD if self._bar else LINE_PERIOD
        if now - self._shown < period:
            return
        self._shown = now
        left = f', {in_words(seconds_left)} left' if math.isfinite(seconds_left) else ''
        if not self._bar:
            count = f'{done} of {planned}' if done <= planned else f'{done}'  # led by hand: more
            line = f'{count} {things or self._things}{left}, {where}'
            print(line, file=self._stream, flush=True)
            return
        text = f' {done}/{planned}{left}, {where}'
        # a line that wraps cannot be written over
        room = _columns(self._stream) - 1
        bar = max(min(BAR, room - len(text) - 2), SHORTEST_BAR)
        filled = min(bar, bar * done // max(planned, 1))
        line = f'[{"#" * filled}{"." * (bar - filled)}]{text}'
        print(f'\r{line[:room]}\x1b[K', end='', file=self._stream)
        self._stream.flush()
        self._open = True

    def say(self, line: str) -> None:
        """A line of its own, clear of the bar."""
        self.clear()
        print(line, file=self._stream, flush=True)

    def clear(self) -> None:
        """Take the bar away, if there is one."""
        if self._open:
            print('\r\x1b[K', end='', file=self._stream, flush=True)
            self._open = False


class Pace:
    """Tells a `Progress` of one stretch of work, with the time left at the pace so far.

    Short work passes without a word, and without a `progress` all of it. `unit` is how many of what
    is counted make one of the `things`: 1e6 where bytes are counted and MB shown.
    """

    def __init__(
        self, progress: Progress | None, where: str, things: str = '', unit: float = 1.0
    ) -> None:
        self._progress = progress
        self._where = where
        self._things = things
        self._unit = unit
        self._begin = time.monotonic()

    def __call__(self, done: int, planned: int) -> None:
        """`done` out of `planned` are done."""
        now = time.monotonic()
        spent = now - self._begin
        if self._progress is None or spent < QUIET:
            return
        # the first steps say little of the pace
        left = spent / done * (planned - done) if done > planned * FIRST else math.nan
        done, planned = round(done / self._unit), round(planned / self._unit)
        self._progress.show(done, planned, left, self._where, now, self._things)

    def end(self) -> None:
        """Take the bar away, if there is one."""
        if self._progress is not None:
            self._progress.clear()


def paced(
    items: Sequence[T], progress: Progress | None, where: str, things: str, every: int = 1
) -> Iterator[T]:
    """The items one after the other, told of with each `every`-th."""
    pace = Pace(progress, where, things)
    for number, item in enumerate(items):
        if number % every == 0:
            pace(number, len(items))
        yield item
    pace.end()


def _columns(stream: TextIO) -> int:
    """Of the terminal that a stream writes to."""
    try:
        return os.get_terminal_size(stream.fileno()).columns or COLUMNS
    except (OSError, ValueError):  # no terminal after all, as in a test
        return COLUMNS


def in_words(seconds: float) -> str:
    """A duration, s, as people say it."""
    whole = round(seconds)
    if whole < 60:
        return f'{whole} s'
    minutes, rest = divmod(whole, 60)
    return f'{minutes} min {rest:02d} s' if minutes < 60 else f'{minutes / 60:.1f} h'
