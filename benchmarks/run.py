# SPDX-License-Identifier: Apache-2.0
"""`make bench`: every part in turn, ratios on stdout, the same in output/bench.json."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import scipy

from benchmarks.command import whole_command, whole_demo
from benchmarks.graph import stepped_capture, streams
from benchmarks.identification import whole_identification
from benchmarks.kernel import against_numpy
from benchmarks.measuring import Part, table
from benchmarks.pairing import hand_guided_recording
from benchmarks.peers import against_pybotics, against_scipy
from benchmarks.points import whole_points
from benchmarks.problems import CHAPTER
from benchmarks.reference import compare
from benchmarks.scale import SIZES, scale

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = 'CERES_REFERENCE'
#: turns where one takes seconds
FEW_ROUNDS = 5
DEFAULT_REFERENCE = ROOT.parent / 'shared/bench/ceres_reference.cpp'


def arguments() -> argparse.ArgumentParser:
    """The command line of the benchmarks."""
    parser = argparse.ArgumentParser(prog='benchmarks', description=__doc__)
    parser.add_argument('--part', action='append', choices=PARTS, help='only these')
    parser.add_argument('--rounds', type=int, default=15, help='turns of each contender')
    parser.add_argument('--poses', type=int, default=CHAPTER)
    parser.add_argument('--sizes', type=int, nargs='+', default=SIZES, help='of the scale part')
    parser.add_argument(
        '--reference',
        type=Path,
        default=os.environ.get(REFERENCE, DEFAULT_REFERENCE),
        help=f'C++ source to build and compare with (or the variable {REFERENCE})',
    )
    parser.add_argument('--strict', action='store_true', help='exit with 1 when a target is missed')
    parser.add_argument('--output', type=Path, default=ROOT / 'output/bench.json')
    return parser


Given = argparse.Namespace
PARTS: dict[str, Callable[[Given], Part]] = {
    'reference': lambda given: compare(given.reference, given.poses, given.rounds),
    'scipy': lambda given: against_scipy(given.poses, min(given.rounds, FEW_ROUNDS)),
    'pybotics': lambda given: against_pybotics(given.poses, min(given.rounds, FEW_ROUNDS)),
    'kernel': lambda given: against_numpy(given.poses, given.rounds),
    'identify': lambda given: whole_identification(given.poses, given.rounds),
    'scale': lambda given: scale(tuple(given.sizes), min(given.rounds, FEW_ROUNDS - 2)),
    'command': lambda given: whole_command(given.poses, min(given.rounds, FEW_ROUNDS)),
    'points': lambda given: whole_points(min(given.rounds, FEW_ROUNDS - 2)),
    'demo': lambda given: whole_demo(),
    'pairing': lambda given: hand_guided_recording(min(given.rounds, FEW_ROUNDS)),
    'capture': lambda given: stepped_capture(),
    'streams': lambda given: streams(),
}
#: these take a recording or the graph a minute each: only when asked for
ASKED_FOR = ('demo', 'pairing', 'capture', 'streams')


def run(given: Given) -> Iterator[tuple[str, Part]]:
    """The chosen parts, each as soon as it is done."""
    for name in given.part or [name for name in PARTS if name not in ASKED_FOR]:
        yield name, PARTS[name](given)


def machine() -> dict[str, object]:
    """What the absolute times depend on."""
    return {
        'cores': os.cpu_count(),
        'processor': platform.machine(),
        'load': os.getloadavg()[0],
        'python': platform.python_version(),
        'numpy': np.__version__,
        'scipy': scipy.__version__,
    }


def record(parts: dict[str, Part], on: dict[str, object]) -> dict[str, object]:
    """The content of bench.json."""
    content: dict[str, object] = {'schema': 1, 'machine': on}
    content['parts'] = {
        name: {**asdict(part), 'targets': [{**asdict(t), 'met': t.met} for t in part.targets]}
        for name, part in parts.items()
    }
    return content


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, with --strict 1 when a target is missed."""
    given = arguments().parse_args(argv)
    parts: dict[str, Part] = {}
    on = machine()
    print(f'{on["cores"]} cores, load {on["load"]:.1f} before the start\n', flush=True)
    for name, part in run(given):
        print(table(part) + '\n', flush=True)
        parts[name] = part
    given.output.parent.mkdir(parents=True, exist_ok=True)
    given.output.write_text(json.dumps(record(parts, on), indent=1) + '\n', encoding='utf-8')
    print(f'wrote {given.output}')
    missed = [target for part in parts.values() for target in part.targets if not target.met]
    return 1 if given.strict and missed else 0


if __name__ == '__main__':
    sys.exit(main())
