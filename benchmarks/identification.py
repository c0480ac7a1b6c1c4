# SPDX-License-Identifier: Apache-2.0
"""`identify()` with all its checks, left-out fits and joint errors, against its own solve."""

from __future__ import annotations

from benchmarks.measuring import Part, Row, Target, best_of, timed
from benchmarks.problems import faro_measurement
from benchmarks.solving import solve
from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable, identifiable_table
from calib_solver import Options, identify
from calib_solver.problem import Problem, SphereSums, accumulate, accumulate_numpy

#: against one solve of the same poses
WHOLE_LIMIT, QUICK_LIMIT = 20.0, 3.0
SOLVE, WHOLE, QUICK = 'solve', 'identify()', 'identify(quick=True)'


def whole_identification(poses: int, rounds: int) -> Part:
    """Seconds of all that `identify` does, and with joint errors in numpy, as it once was."""
    measured = faro_measurement(poses)
    problem = Problem.of(measured)
    table = identifiable_table(measured.arm, measured.probe)
    best = best_of(
        {
            SOLVE: timed(lambda: solve(problem, table)),
            QUICK: timed(lambda: identify(measured, Options(quick=True))),
            WHOLE: timed(lambda: identify(measured)),
            'joint errors in numpy': timed(lambda: identify(measured, passes=_joint_errors_apart)),
        },
        rounds,
    )
    rows = tuple(Row(name, s, s / best[SOLVE], SOLVE) for name, s in best.items())
    targets = (
        Target(f'{WHOLE} against its solve', best[WHOLE] / best[SOLVE], WHOLE_LIMIT),
        Target(f'{QUICK} against its solve', best[QUICK] / best[SOLVE], QUICK_LIMIT),
    )
    return Part(f'identification of {poses} poses', rows, targets)


def _joint_errors_apart(problem: Problem, table: ParameterTable, full: Array) -> SphereSums:
    """The compiled pass, but numpy where joint errors are among the columns."""
    chosen = accumulate if table.joint_terms is None else accumulate_numpy
    return chosen(problem, table, full)
