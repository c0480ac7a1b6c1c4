# SPDX-License-Identifier: Apache-2.0
"""`identify` of measured points as a user calls it: three targets from three stations, turned too.

Seconds are the processor's, of all threads: what else the machine does is no part of them.
"""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.measuring import Part, Row, Target
from benchmarks.problems import CONFIG
from calib_model.arrays import Array
from calib_model.bags import write_points
from calib_model.descriptions import parse_arm, read_description
from calib_model.kinematics import forward_kinematics
from calib_model.measured_points import PointMeasurement, PointSet
from calib_model.transforms import rotation_matrix, rotation_vector_quaternion, rotation_vectors

#: points, and the seconds that the whole command may take of them
LIMITS = {1_000: 3.0, 10_000: 10.0}
MEMORY_LIMIT = 1 << 30  # bytes
BARE = 'python, numpy imported'
TARGETS, STATIONS = 3, 3
#: m, rad
NOISE, TURN_NOISE = 4e-5, 1e-4
OFF = np.array([5e-4, 1e-3, 5e-4, 2e-3, 0.0])[:, None]
#: the command, and the most bytes that it ever had
COMMAND = """
import sys
from calib_solver.commands.identify import main
code = main(sys.argv[1:])
from benchmarks.measuring import peak_memory
print(peak_memory())
sys.exit(code)
"""


def measured_points(count: int, seed: int = 1) -> PointMeasurement:
    """Points of a KR 5 off its description, in postures anywhere."""
    generator = np.random.default_rng(seed)
    arm = read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm)
    off = OFF * generator.normal(size=arm.geometry.shape)
    lower, upper = arm.ranges.T
    joints = generator.uniform(lower, upper, (count, arm.n))
    flange = forward_kinematics(arm.with_geometry(arm.geometry + off), joints)
    places = generator.uniform(-0.2, 0.2, (TARGETS, 3)), generator.uniform(-3, 3, (STATIONS, 3))
    turns, bases = (_turns(generator.normal(size=(k, 3))) for k in (TARGETS, STATIONS))
    target, station = np.arange(count) % TARGETS, np.arange(count) // TARGETS % STATIONS
    base = bases[station]
    here = flange[:, :3, 3] + np.einsum('nij,nj->ni', flange[:, :3, :3], places[0][target])
    seen = np.einsum('nij,nj->ni', base, here) + places[1][station]
    seen += NOISE * generator.normal(size=seen.shape)
    turned = _turns(TURN_NOISE * generator.normal(size=(count, 3))) @ base
    turned = turned @ flange[:, :3, :3] @ turns[target]
    quaternions = np.array([rotation_vector_quaternion(v) for v in rotation_vectors(turned)])
    names = [f'{k + 1}' for k in target]
    return PointMeasurement(arm, PointSet.of(joints, seen, quaternions, names, station + 1))


def _turns(vectors: Array) -> Array:
    return np.array([rotation_matrix(vector) for vector in vectors])


def whole_points(rounds: int) -> Part:
    """The best of some turns for each number of points."""
    with TemporaryDirectory() as folder:
        runs = {BARE: [sys.executable, '-c', 'import numpy; print(0)']}
        for count in LIMITS:
            write_points(Path(folder) / str(count), measured_points(count))
            words = [f'{folder}/{count}', '--output', f'{folder}/out{count}']
            runs[f'{count:,} points'] = [sys.executable, '-c', COMMAND, *words]
        best: dict[str, tuple[float, int]] = {}
        for _ in range(rounds):
            for name, command in runs.items():
                seconds, peak = _seconds(command)
                if name not in best or seconds < best[name][0]:
                    best[name] = (seconds, peak)
    bare = best[BARE][0]
    rows = tuple(
        Row(name, seconds, seconds / bare, BARE, f'peak {peak / 2**20:.0f} MiB' if peak else '')
        for name, (seconds, peak) in best.items()
    )
    targets = [
        Target(f'seconds of {count:,} points', best[f'{count:,} points'][0], limit)
        for count, limit in LIMITS.items()
    ]
    largest = max(peak for _, peak in best.values())
    targets.append(Target('peak memory, MiB', largest / 2**20, MEMORY_LIMIT / 2**20))
    return Part('the whole command on bags of measured points', rows, tuple(targets))


def _seconds(command: list[str]) -> tuple[float, int]:
    """A process's seconds of the processor, and the number that it printed last."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return used, int(done.stdout.splitlines()[-1])
