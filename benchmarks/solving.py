# SPDX-License-Identifier: Apache-2.0
"""What the peers are measured against: eq. 11 minimised without a prior, on a given free set."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting import (
    NO_PRIOR,
    Fit,
    Objective,
    Quadratic,
    distance_repeatability,
    minimise,
)
from calib_solver.problem import Problem, accumulate


def solve(
    problem: Problem, table: ParameterTable, chosen: Objective = distance_repeatability
) -> Fit:
    """Levenberg-Marquardt from the nominal parameters."""
    nominal = table.nominal[table.free_columns]

    def evaluate(x: Array) -> Quadratic:
        return chosen(problem, accumulate(problem, table, table.full(nominal + x)))

    start = np.zeros(len(nominal))
    return minimise(evaluate, start, NO_PRIOR.sigmas(table), NO_PRIOR.information(table))
