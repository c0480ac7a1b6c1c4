# SPDX-License-Identifier: Apache-2.0
"""One pass over the poses: the compiled kernel against its numpy twin."""

from __future__ import annotations

from dataclasses import fields
from functools import partial

import numpy as np

from benchmarks.measuring import Part, Row, Target, best_of, timed
from benchmarks.problems import faro_measurement
from calib_model.kinematics import identifiable_table
from calib_solver.problem import Problem, SphereSums, accumulate, accumulate_numpy

#: both round, and sums of many terms are taken in another order
SAME_SUMS = 1e-9


def against_numpy(poses: int, rounds: int) -> Part:
    """Seconds of one pass, for the passive and the active probe."""
    rows: list[Row] = []
    targets = []
    for active in (False, True):
        measured = faro_measurement(poses, active=active)
        problem = Problem.of(measured)
        table = identifiable_table(measured.arm, measured.probe)
        arguments = (problem, table, table.nominal)
        kind = f'{measured.probe.kind} probe'
        best = best_of(
            {
                'numpy': timed(partial(accumulate_numpy, *arguments)),
                'compiled': timed(partial(accumulate, *arguments)),
            },
            rounds,
        )
        for name, seconds in best.items():
            note = f'{seconds / poses * 1e9:.0f} ns a pose'
            rows.append(Row(f'{name}, {kind}', seconds, seconds / best['numpy'], 'numpy', note))
        apart = _apart(accumulate(*arguments), accumulate_numpy(*arguments))
        targets.append(Target(f'sums apart, {kind}, relative', apart, SAME_SUMS))
    return Part(f'one pass over {poses} poses', tuple(rows), tuple(targets))


def _apart(one: SphereSums, other: SphereSums) -> float:
    """The largest difference in any of the sums, against the largest number in it."""
    apart = 0.0
    for column in fields(SphereSums):
        a, b = getattr(one, column.name), getattr(other, column.name)
        apart = max(apart, float(np.abs(a - b).max() / np.abs(b).max()))
    return apart
