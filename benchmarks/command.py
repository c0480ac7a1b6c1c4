# SPDX-License-Identifier: Apache-2.0
"""`identify BAG` as a user calls it: interpreter, bag, eq. 15 and results included."""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.measuring import Part, Row, Target, best_of, timed
from benchmarks.problems import faro_measurement
from calib_model.bags import write_measurement

#: against an interpreter that has loaded numpy
HELP_LIMIT, IDENTIFY_LIMIT = 1.5, 3.0
BARE, HELP, IDENTIFY = 'python, numpy imported', 'identify --help', 'identify BAG'
DEMO_LIMIT = 60.0  # s, after set-up
MODULE = [sys.executable, '-m', 'calib_solver.commands.identify']


def whole_command(poses: int, rounds: int) -> Part:
    """Seconds of the module and, where `ros2` is on the path, of the documented command."""
    with TemporaryDirectory() as folder:
        bag = Path(folder) / 'bag'
        write_measurement(bag, faro_measurement(poses, active=True))
        output = ['--output', str(Path(folder) / 'results')]
        contenders = {
            BARE: _run([sys.executable, '-c', 'import numpy']),
            HELP: _run([*MODULE, '--help']),
            IDENTIFY: _run([*MODULE, str(bag)]),
            'identify BAG --output DIR': _run([*MODULE, str(bag), *output]),
        }
        if shutil.which('ros2'):
            command = ['ros2', 'run', 'calib_solver', 'identify', str(bag), *output]
            contenders['ros2 run calib_solver identify BAG --output DIR'] = _run(command)
        best = best_of(contenders, rounds)
    rows = tuple(Row(name, s, s / best[BARE], BARE) for name, s in best.items())
    targets = (
        Target(f'{HELP} against numpy', best[HELP] / best[BARE], HELP_LIMIT),
        Target(f'{IDENTIFY} against numpy', best[IDENTIFY] / best[BARE], IDENTIFY_LIMIT),
    )
    return Part(f'the whole command on a bag of {poses} poses, active probe', rows, targets)


def whole_demo() -> Part:
    """Seconds of `make demo` where all is set up, once."""
    with TemporaryDirectory() as folder:
        output = ['--output', str(Path(folder) / 'out')]
        bare = _run([sys.executable, '-c', 'import numpy'])()
        seconds = _run([sys.executable, '-m', 'calib_bringup.demo', *output])()
    rows = (Row(BARE, bare, 1.0, BARE), Row('the demo', seconds, seconds / bare, BARE))
    return Part('the demo, once', rows, (Target('seconds of the demo', seconds, DEMO_LIMIT),))


def _run(command: list[str]) -> Callable[[], float]:
    return timed(lambda: subprocess.run(command, check=True, capture_output=True, timeout=300))
