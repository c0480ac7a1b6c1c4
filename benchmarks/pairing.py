# SPDX-License-Identifier: Apache-2.0
"""`pair` of a hand-guided recording against `identify --raw`: both read and pair all of it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measuring import Part, Row, Target, best_of, timed

#: three spheres at two locations take the simulated hand five minutes
RECORDED = ['--probe', 'active', '--locations', '1', '2', '--spheres', '1', '6', '10']
PLACES = Path(__file__).resolve().parents[1] / (
    'ros2_ws/src/calib_bringup/config/locations/faro.yaml'
)
LIMIT = 2.0  # times as long as identify --raw
RAW, PAIR = 'identify --raw', 'pair'


def hand_guided_recording(rounds: int) -> Part:
    """Seconds of both commands whole, on the same recording."""
    with TemporaryDirectory() as folder:
        bag, numbers = Path(folder) / 'bag', count()
        _run('selfcenter_probe.commands.hand_guided', str(bag), '--raw', *RECORDED)
        led = ['--mode', 'continuous', '--placements', str(PLACES)]

        def identify() -> None:
            output = ['--output', str(Path(folder) / 'results')]
            _run('calib_solver.commands.identify', str(bag), '--raw', *output)

        def pair() -> None:
            out = Path(folder) / f'paired_{next(numbers)}'
            _run('calib_capture.commands.pair', str(bag), str(out), *led)

        contenders: dict[str, Callable[[], float]] = {RAW: timed(identify), PAIR: timed(pair)}
        best = best_of(contenders, rounds)
    rows = tuple(Row(name, s, s / best[RAW], RAW) for name, s in best.items())
    targets = (Target('pair of a recording over identify --raw', best[PAIR] / best[RAW], LIMIT),)
    return Part('a hand-guided recording of five minutes, both commands whole', rows, targets)


def _run(module: str, *words: str) -> None:
    command = [sys.executable, '-m', module, *words]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
