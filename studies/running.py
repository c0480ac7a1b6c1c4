# SPDX-License-Identifier: Apache-2.0
"""How a study runs and is written down: seeds over processes, one text file for its table."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

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


def study(name: str, about: str, count: int, table: Callable[[int], list[str]]) -> None:
    """Run a study from its command line: the table on stdout and in results/NAME.txt.

    The file is written at the full `count` only, so that a quick look leaves it alone.
    """
    parser = argparse.ArgumentParser(prog=f'python -m studies.{name}', description=about)
    parser.add_argument('--count', type=int, default=count, help='(default: %(default)s)')
    given = parser.parse_args()
    lines = [f'$ python -m studies.{name}', '', *about.strip().splitlines(), '']
    lines += table(given.count)
    text = '\n'.join(line.rstrip() for line in lines) + '\n'
    print(text, end='')
    if given.count == count:
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / f'{name}.txt').write_text(text, encoding='utf-8')


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
