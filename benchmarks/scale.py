# SPDX-License-Identifier: Apache-2.0
"""Time per pose and peak memory from a thousand poses to a million, a process per size.

`python -m benchmarks.scale FILE` is that process: it identifies from the poses in FILE and prints
its figures as JSON. Making the poses takes memory of its own, so it is done elsewhere.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np

from benchmarks.measuring import Part, Row, Target, peak_memory
from benchmarks.problems import faro, faro_measurement
from benchmarks.solving import solve
from calib_model.kinematics import identifiable_table
from calib_model.measurement import Measurement, ProbingSet
from calib_solver.fitting import NO_PRIOR, Options
from calib_solver.identification import identify
from calib_solver.problem import Problem

SIZES = (1_000, 10_000, 100_000, 1_000_000)
#: time per pose at the largest size over that at ten thousand; bytes
PER_POSE_LIMIT, MEMORY_LIMIT = 1.3, 1 << 30
COMPARED = 10_000
#: the small sizes are over in no time: about this many poses are solved in all
POSES_IN_ALL = 500_000
TIMED = ('solve', 'identify')


def scale(sizes: tuple[int, ...] = SIZES, rounds: int = 3) -> Part:
    """A line per size, for the passive probe; and one with eq. 15 for the largest."""
    largest = max(sizes)
    with TemporaryDirectory() as folder:
        files = {size: _kept(Path(folder), size, active=False) for size in sizes}
        with_readings = _kept(Path(folder), largest, active=True)
        runs = {size: _figures_of(file) for size, file in files.items()}
        active = _figures_of(with_readings)
        for _ in range(rounds - 1):  # in turns, so that a busy moment troubles all sizes alike
            runs = {size: _better(runs[size], _figures_of(files[size])) for size in sizes}
    compared = COMPARED if COMPARED in runs else min(runs)
    rows = [
        _row(f'{size:,} poses, {what}', what, run, runs[compared], compared)
        for what in TIMED
        for size, run in runs.items()
    ]
    rows.append(
        _row(f'{largest:,} poses, identify, eq. 15 too', TIMED[1], active, runs[compared], compared)
    )
    targets = [Target('peak memory, MiB', runs[largest]['bytes'] / 2**20, MEMORY_LIMIT / 2**20)]
    targets.append(
        Target('peak memory with eq. 15, MiB', active['bytes'] / 2**20, MEMORY_LIMIT / 2**20)
    )
    for what in TIMED:
        ratio = _per_pose(runs[largest], what) / _per_pose(runs[compared], what)
        name = f'{what}: time per pose at {largest:,} over {compared:,}'
        targets.append(Target(name, ratio, PER_POSE_LIMIT))
    return Part('scale: passive probe, identifiable parameters free', tuple(rows), tuple(targets))


def _per_pose(run: dict[str, float], what: str) -> float:
    return run[what] / run['poses']


def _row(
    name: str, what: str, run: dict[str, float], other: dict[str, float], compared: int
) -> Row:
    """One line; its ratio is of times per pose."""
    note = f'{_per_pose(run, what) * 1e6:.3f} us a pose, peak {run["bytes"] / 2**20:.0f} MiB'
    if what == TIMED[0]:
        note = f'{_per_pose(run, what) * 1e6:.3f} us a pose in {run["evaluations"]:.0f} passes'
    ratio = _per_pose(run, what) / _per_pose(other, what)
    return Row(name, run[what], ratio, f'{compared:,}, per pose', note, run)


def _kept(folder: Path, size: int, active: bool) -> Path:
    """The poses of one size in a file of their own."""
    taken = faro_measurement(size, active=active).poses
    file = folder / f'{size}_{"active" if active else "passive"}.npz'
    np.savez(
        file,
        location=taken.location,
        sphere=taken.sphere,
        joints=taken.joints,
        displacement=taken.displacement,
        active=active,
    )
    return file


def _figures_of(file: Path) -> dict[str, float]:
    """What a fresh process finds of the poses in a file."""
    done = subprocess.run(
        [sys.executable, '-m', 'benchmarks.scale', str(file)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        cwd=Path(__file__).resolve().parents[1],
    )
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def _better(one: dict[str, float], other: dict[str, float]) -> dict[str, float]:
    """The shorter times of two runs and the larger of everything else."""
    return {
        name: (min if name in TIMED else max)(value, other[name]) for name, value in one.items()
    }


def _figures(file: Path) -> dict[str, float]:
    """What the process of one size finds: seconds, passes, bytes."""
    before = peak_memory()
    with np.load(file) as kept:
        arm, probe, gauge = faro(active=bool(kept['active']))
        taken = ProbingSet.of(
            kept['location'], kept['sphere'], kept['joints'], kept['displacement']
        )
    measured = Measurement(arm, probe, gauge, taken)
    times = int(np.clip(POSES_IN_ALL // len(taken), 2, 50))
    options = Options(prior=NO_PRIOR)
    whole = _best(lambda: identify(measured, options), times)
    peak = peak_memory()
    problem, table = Problem.of(measured), identifiable_table(arm, probe)
    evaluations = solve(problem, table).evaluations
    return {
        'poses': len(taken),
        'solve': _best(lambda: solve(problem, table), times),
        'identify': whole,
        'evaluations': evaluations,
        'bytes': peak,
        'bytes_before': before,
    }


def _best(work: Callable[[], object], times: int) -> float:
    best = float('inf')
    for _ in range(times):
        begun = perf_counter()
        work()
        best = min(best, perf_counter() - begun)
    return best


if __name__ == '__main__':
    print(json.dumps(_figures(Path(sys.argv[1]))))
