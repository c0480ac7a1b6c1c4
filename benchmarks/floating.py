# SPDX-License-Identifier: Apache-2.0
"""The C++ reference's objective on our sums.

Eq. 11 takes distances between the means of what was probed. The reference makes each sphere's
centre an unknown, so that a centre may leave its mean by delta to please the distances:

    sum_s 4 n / (n - 1) |delta_s|^2 + |e + G delta|^2,   e = D - D0, G its slope by the centres,

whose minimum over delta is e'(1 + G K^-1 G')^-1 e with K the first sum's weights. To compare
minima digit by digit both must minimise the same, so here is that one, centres eliminated.
"""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting import Quadratic, distance_errors, repeatability, repeatability_weights
from calib_solver.problem import Problem, SphereSums


def floating_centers(problem: Problem, sums: SphereSums) -> Quadratic:
    """Eq. 11 with every sphere's centre free to leave its mean; needs 2 poses of each sphere."""
    error, slope = distance_errors(problem, sums)
    weight = _weight(problem, sums)
    weighted = weight @ slope
    moved = Quadratic(
        float(error @ weight @ error), weighted.T @ error, slope.T @ weighted, len(error)
    )
    return moved + repeatability(problem, sums)


def _weight(problem: Problem, sums: SphereSums) -> Array:
    """(1 + G K^-1 G')^-1 of all distances, shape (M, M)."""
    first, second = problem.pairs.T
    between = sums.center[first] - sums.center[second]
    unit = between / np.linalg.norm(between, axis=1)[:, None]
    rows = np.arange(len(unit))
    by_center = np.zeros((len(unit), len(sums.count), 3))
    by_center[rows, first] = unit
    by_center[rows, second] = -unit
    give = 1 / (repeatability_weights(sums) * sums.count)
    spread = np.einsum('msk,s,lsk->ml', by_center, give, by_center)
    weight: Array = np.linalg.inv(np.eye(len(unit)) + spread)
    return weight
