# SPDX-License-Identifier: Apache-2.0
"""How much a single probing pose scatters, by what the parameters leave of poses and distances."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting.objectives import Quadratic, distance_errors
from calib_solver.problem import IntArray, Problem, SphereSums

#: m, of a pose's coordinate where so few poses are left to tell it by that all are met exactly
ASSUMED_NOISE = 5e-5
#: spheres this much nearer to one line, or plane, than they are apart stand on it
LINE = 1e-2
#: directions whose part of J'J is below this one of the largest are rounding
ROUNDING = 1e-14


def redundancy(sums: SphereSums) -> int:
    """Coordinates of poses beyond their spheres' means, less the free parameters."""
    return 3 * int(np.maximum(sums.count - 1, 0).sum()) - sums.gradient.shape[1]


def noise_variance(
    problem: Problem, name: str, sums: SphereSums, quadratic: Quadratic
) -> tuple[float, bool]:
    """Variance (m^2) of one pose's coordinate, and whether it had to be assumed.

    Told by the poses about their spheres' means where they are redundant; where every sphere has
    about one pose, by what the parameters leave of the distances to the certificate's points.
    """
    if redundancy(sums) >= 1:
        slope = distance_errors(problem, sums)[1] if name == 'distance' else None
        return pose_variance(sums, slope), False
    rank = full_inverse(quadratic.normal)[1]
    # of a coordinate, by the certificate alone
    certified = (problem.measured.gauge.constant / 2) ** 2 / 2
    if name == 'position':
        freedom = quadratic.terms - rank
        left = quadratic.phi / max(freedom, 1) - certified
    else:
        independent = independent_distances(problem)
        freedom = independent - rank
        error, _ = distance_errors(problem, sums)
        square = float(error @ error) / max(len(error), 1) * independent / max(freedom, 1)
        each = (1 / np.maximum(sums.count, 1))[problem.pairs].sum(axis=1)
        left = (square - 2 * certified) / max(float(np.sum(each)) / max(len(error), 1), 1e-300)
    return (ASSUMED_NOISE**2, True) if freedom < 1 else (max(left, 0.0), False)


def independent_distances(problem: Problem) -> int:
    """How many of the certified distances do not follow from the others, to first order."""
    return sum(_independent_distances(problem, rows) for rows in problem.placements)


def _independent_distances(problem: Problem, rows: IntArray) -> int:
    """How many of the distances among the spheres `rows` of one placement do not follow from the
    others, to first order: those along a line, in a plane, in space."""
    if len(rows) < 2:
        return 0
    gauge = problem.measured.gauge
    centers = np.array([gauge.center(int(number)) for number in problem.keys[rows, 1]])
    values = np.linalg.svd(centers - centers.mean(axis=0), compute_uv=False)
    extent = int((values > LINE * values[0]).sum())
    return extent * len(rows) - extent * (extent + 1) // 2


def pose_variance(sums: SphereSums, slope: Array | None = None) -> float:
    """Variance of one pose's coordinate about its sphere's mean, pooled over all spheres, m^2.

    With `slope` (M, F), the distances' Jacobian, the sums are those at a minimum of the distances
    alone: eq. 13 does not look at the poses and leaves them scattering as far as its parameters
    are off, so what these could still take up while the distances hold is no noise. Did nothing
    hold, a passive probe's poses would come together as the whole arm shrinks.
    """
    left = float(sums.spread.sum())
    gradient, normal = sums.gradient.sum(axis=0), sums.normal.sum(axis=0)
    if slope is None:
        rank = len(gradient)
    else:
        inverse, rank = full_inverse(normal + float(sums.count.mean()) * slope.T @ slope)
        left -= float(gradient @ inverse @ gradient)
    freedom = 3 * float(np.maximum(sums.count - 1, 0).sum())
    return max(left, 0.0) / max(freedom - rank, 1.0)


def full_inverse(hessian: Array) -> tuple[Array, int]:
    """The inverse in the directions that stand out from rounding, zero in the others, and how
    many stand out."""
    size = np.diag(hessian)
    # a column that nothing tells has no part in any direction, not even that of rounding
    scale = np.where(size > 0, 1 / np.sqrt(np.maximum(size, 1e-300)), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * hessian * scale)
    kept = values > ROUNDING * values.max(initial=1e-300)
    inverse = (vectors[:, kept] / values[kept]) @ vectors[:, kept].T
    result: Array = scale[:, None] * inverse * scale
    return result, int(kept.sum())
