# SPDX-License-Identifier: Apache-2.0
"""How times are taken and written down: the best of alternating runs, and ratios of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter


@dataclass(frozen=True)
class Row:
    """One line: `ratio` is this time over that of the row called `against`, in the same run."""

    name: str
    seconds: float | None = None
    ratio: float | None = None
    against: str = ''
    note: str = ''
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Target:
    """A ratio or size that must not exceed `limit`."""

    name: str
    value: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether it holds in this run."""
        return self.value <= self.limit


@dataclass(frozen=True)
class Part:
    """One benchmark: its lines, and what must hold of them."""

    title: str
    rows: tuple[Row, ...]
    targets: tuple[Target, ...] = ()


def timed(work: Callable[[], object]) -> Callable[[], float]:
    """`work` as something that tells its own seconds."""

    def run() -> float:
        begun = perf_counter()
        work()
        return perf_counter() - begun

    return run


def best_of(contenders: dict[str, Callable[[], float]], rounds: int) -> dict[str, float]:
    """The best seconds of each, taken in turns so that a busy moment troubles all alike."""
    best = dict.fromkeys(contenders, float('inf'))
    for _ in range(rounds):
        for name, run in contenders.items():
            best[name] = min(best[name], run())
    return best


def table(part: Part) -> str:
    """A part as text."""
    lines = [part.title]
    width = max(len(row.name) for row in part.rows)
    for row in part.rows:
        seconds = '' if row.seconds is None else f'{row.seconds:.4g} s'
        ratio = '' if row.ratio is None else f'{row.ratio:.3g} x {row.against}'
        lines.append(f'  {row.name:{width}}  {seconds:>10}  {ratio:32}  {row.note}'.rstrip())
    for target in part.targets:
        verdict = 'holds' if target.met else 'MISSED'
        lines.append(f'  {verdict}: {target.name}: {target.value:.3g}, at most {target.limit:.3g}')
    return '\n'.join(lines)


def peak_memory() -> int:
    """The most bytes that were ever resident; getrusage would count the parent's before exec."""
    found = re.search(r'^VmHWM:\s+(\d+) kB', Path('/proc/self/status').read_text(), re.MULTILINE)
    return int(found.group(1)) * 1024 if found else 0
