# SPDX-License-Identifier: Apache-2.0
"""Our solve against a C++ reference on Ceres: same problem, same start, same run.

The reference's source is given from outside; it is built in a folder that goes away again.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.floating import floating_centers
from benchmarks.measuring import Part, Row, Target, best_of, timed
from benchmarks.problems import faro_measurement, reference_table
from benchmarks.solving import solve
from calib_model.errors import CalibrationError
from calib_model.kinematics import identifiable_table
from calib_solver.problem import Problem

#: ours over the reference's: what must hold, and the goal
LIMIT, GOAL, SAME_PHI = 0.5, 0.2, 1e-6
FLAGS = ('-O3', '-march=native', '-I/usr/include/eigen3')
LIBRARIES = ('-lceres', '-lglog')


class MissingPeer(CalibrationError):
    """The reference cannot be had here; the message says why."""


def compare(source: Path, poses: int, rounds: int) -> Part:
    """Times of both, and whether they end in the same minimum."""
    title = f'against the C++ reference, {poses} poses, 27 parameters free in both, no prior'
    try:
        with TemporaryDirectory() as folder:
            return _compared(title, _built(source, Path(folder)), poses, rounds)
    except MissingPeer as missing:
        return Part(title, (Row('C++ reference (Ceres)', note=f'not installed: {missing}'),))


def write_problem(path: Path, problem: Problem, start: np.ndarray) -> None:
    """A problem of six joints in the reference's own file format, little endian."""
    sphere = np.repeat(np.arange(len(problem.keys)), problem.counts)
    sizes = (len(problem.joints), len(problem.keys), len(problem.pairs))
    with path.open('wb') as file:
        file.write(np.array(sizes, '<i4').tobytes())
        file.write(problem.joints.astype('<f8').tobytes())
        for integers in (sphere, problem.counts, problem.pairs):
            file.write(integers.astype('<i4').tobytes())
        file.write(problem.nominal.astype('<f8').tobytes())
        file.write(start.astype('<f8').tobytes())


def _built(source: Path, folder: Path) -> Path:
    if not source.is_file():
        raise MissingPeer(f'no source at {os.path.relpath(source)}')
    compiler = shutil.which('g++')
    if compiler is None:
        raise MissingPeer('no g++')
    program = folder / 'reference'
    command = [compiler, str(source), '-o', str(program), *FLAGS, *LIBRARIES]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if done.returncode != 0:
        error = re.search(r'(fatal error|error): .*', done.stderr)
        raise MissingPeer(error.group(0) if error else 'it does not build (libceres-dev?)')
    return program


def _compared(title: str, program: Path, poses: int, rounds: int) -> Part:
    measured = faro_measurement(poses)
    problem, table = Problem.of(measured), reference_table(measured)
    file = program.with_name('problem.bin')
    write_problem(file, problem, table.nominal[table.free_columns])
    phi: dict[str, float] = {}

    def reference(threads: int) -> Callable[[], float]:
        def run() -> float:
            seconds, phi['reference'] = _run(program, threads, file)
            return seconds

        return run

    def ours() -> None:
        phi['ours'] = solve(problem, table, floating_centers).quadratic.phi

    def ours_of_eq_11() -> None:
        phi['eq. 11'] = solve(problem, table).quadratic.phi

    cores = os.cpu_count() or 1
    peers = {f'reference, {n} thread{"s" * (n > 1)}': reference(n) for n in sorted({1, cores})}
    fewer = identifiable_table(measured.arm, measured.probe)
    best = best_of(
        {
            'our solve': timed(ours_of_eq_11),
            "our solve, reference's objective": timed(ours),
            'our solve, poses sorted anew': timed(lambda: solve(Problem.of(measured), table)),
            'our solve, identifiable ones free': timed(lambda: solve(problem, fewer)),
            **peers,
        },
        rounds,
    )
    fastest = min(peers, key=lambda name: best[name])
    rows = [Row(name, seconds, seconds / best[fastest], fastest) for name, seconds in best.items()]
    apart = phi['ours'] / phi['reference'] - 1
    rows.append(Row('phi', note=', '.join(f'{k} {v:.7e}' for k, v in phi.items()), figures=phi))
    ratio = best['our solve'] / best[fastest]
    targets = (
        Target('our solve over the reference', ratio, LIMIT),
        Target('our solve over the reference, the goal', ratio, GOAL),
        Target('phi apart on the same objective, relative', abs(apart), SAME_PHI),
    )
    return Part(title, tuple(rows), targets)


def _run(program: Path, threads: int, problem: Path) -> tuple[float, float]:
    """Seconds as the reference takes them (its file read before), and phi: twice Ceres' cost."""
    done = subprocess.run(
        [str(program), str(threads), str(problem)], capture_output=True, text=True, timeout=600
    )
    seconds = re.search(r'total ([\d.]+) s', done.stdout)
    cost = re.search(r'Final cost: ([-+.\de]+)', done.stdout)
    if done.returncode != 0 or seconds is None or cost is None:
        raise MissingPeer('it does not answer as expected')
    return float(seconds.group(1)), 2 * float(cost.group(1))
