# SPDX-License-Identifier: Apache-2.0
"""How a study runs and is written down: seeds over processes, one text file for its table."""

from __future__ import annotations

import argparse
import os
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESULTS = Path(__file__).resolve().parent / 'results'
PROCESSES = 2
Seed = TypeVar('Seed')
Result = TypeVar('Result')


def over_seeds(work: Callable[[Seed], Result], seeds: Iterable[Seed]) -> list[Result]:
    """`work` of every seed, in order, over processes with one thread each."""
    os.environ['CALIB_THREADS'] = '1'
    given = list(seeds)
    found: list[Result] = []
    begun = time.monotonic()
    with ProcessPoolExecutor(PROCESSES) as pool:
        for result in pool.map(work, given, chunksize=2):
            found.append(result)
            if sys.stderr.isatty():
                seconds = time.monotonic() - begun
                sys.stderr.write(f'\r{len(found)} of {len(given)}, {seconds:.0f} s')
    if sys.stderr.isatty():
        sys.stderr.write('\n')
    return found


def study(
    name: str,
    about: str,
    count: int,
    table: Callable[[int], list[str]],
    draw: Callable[[int], Figure] | None = None,
    option: str = 'count',
) -> None:
    """Run a study from its command line: the table on stdout and in results/NAME.txt.

    The file, and results/NAME.png where there is something to `draw`, are written at the default
    `count` only, so that a quick look leaves them alone; `option` is what else it is a number of.
    """
    parser = argparse.ArgumentParser(prog=f'python -m studies.{name}', description=about)
    parser.add_argument(f'--{option}', type=int, default=count, help='(default: %(default)s)')
    given = getattr(parser.parse_args(), option)
    text = written(name, about, table(given))
    print(text, end='')
    if given == count:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / f'{name}.txt').write_text(text, encoding='utf-8')
        if draw is not None:
            # without matplotlib's version in it: the same picture is the same file
            draw(given).savefig(RESULTS / f'{name}.png', dpi=90, metadata={'Software': None})


def written(name: str, about: str, table: Sequence[str]) -> str:
    """A study as its file has it: the command, what it is about, the lines of its table."""
    lines = [f'$ python -m studies.{name}', '', *about.strip().splitlines(), '', *table]
    return '\n'.join(line.rstrip() for line in lines) + '\n'


def findings(claims: Sequence[tuple[str, bool]]) -> list[str]:
    """Lines that say of each claim whether it holds here."""
    return [f'{"yes" if holds else "NO ":4}{claim}' for claim, holds in claims]


def paragraph(text: str) -> list[str]:
    """Lines of running text."""
    return textwrap.wrap(text.strip(), 100)


def columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table, the first column to the left, the others to the right."""
    every = [list(header), *map(list, rows)]
    width = [max(len(row[i]) for row in every) for i in range(len(header))]
    return [
        '  '.join(
            cell.ljust(size) if i == 0 else cell.rjust(size)
            for i, (cell, size) in enumerate(zip(row, width, strict=True))
        )
        for row in every
    ]
