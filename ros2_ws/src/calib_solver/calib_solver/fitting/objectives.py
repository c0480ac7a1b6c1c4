# SPDX-License-Identifier: Apache-2.0
"""The objectives as least-squares problems on the sums per sphere: eqs. 10, 11 and 13.

Each gives phi, half its gradient J'r and J'J by the free parameters, so that one
Levenberg-Marquardt serves all. Spheres with a single pose have no repeatability term, locations
with a single sphere no distance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_solver.problem import IntArray, Problem, SphereSums, place_gauge


@dataclass(frozen=True)
class Quadratic:
    """phi (m^2) with J'r (F,) and J'J (F, F), and how many residuals `terms` it rests on.

    `rows`, where there are few, are J (M, F) and r (M,) themselves: they keep the digits of weak
    directions that squaring loses. `rounding` (m^2) is how far phi may be off by it, where that is
    more than residuals of a metre-sized arm explain.
    """

    phi: float
    gradient: Array
    normal: Array
    terms: float
    rows: tuple[Array, Array] | None = None
    rounding: float = 0.0

    def __add__(self, other: Quadratic) -> Quadratic:
        return Quadratic(
            self.phi + other.phi,
            self.gradient + other.gradient,
            self.normal + other.normal,
            self.terms + other.terms,
        )


def distance_errors(problem: Problem, sums: SphereSums) -> tuple[Array, Array]:
    """D - D0 (M,) in m for every certified distance, and its Jacobian (M, F): eqs. 5 to 7."""
    return errors_between(problem, sums.center, sums.jacobian)


def errors_between(problem: Problem, center: Array, jacobian: Array) -> tuple[Array, Array]:
    """The same for centres (S, 3), m, that go with parameters as their `jacobian` (S, 3, F)."""
    first, second = problem.pairs.T
    measured, unit = apart(center, problem.pairs)
    slope = np.einsum('mk,mkf->mf', unit, jacobian[first] - jacobian[second])
    return measured - problem.nominal, slope


def apart(center: Array, pairs: IntArray) -> tuple[Array, Array]:
    """How far apart (m,) the two centres (S, 3) of each pair (m, 2) are, and the unit vectors
    (m, 3) from the second to the first."""
    between = center[pairs[:, 0]] - center[pairs[:, 1]]
    length = np.linalg.norm(between, axis=1)
    return length, between / np.maximum(length, 1e-300)[:, None]


def distance(problem: Problem, sums: SphereSums) -> Quadratic:
    """Eq. 13: the squared distance errors alone."""
    error, slope = distance_errors(problem, sums)
    root = np.sqrt(problem.pair_weight)
    error, slope = root * error, root[:, None] * slope
    return Quadratic(
        float(error @ error), slope.T @ error, slope.T @ slope, len(error), (slope, error)
    )


def repeatability_weights(sums: SphereSums) -> Array:
    """4 / (n - 1) per sphere (S,), 0 for a sphere with a single pose: eq. 8's factor, squared."""
    many = sums.count > 1 + 1e-9
    return np.where(many, 4.0 / np.where(many, sums.count - 1, 1.0), 0.0)


def repeatability(problem: Problem, sums: SphereSums) -> Quadratic:
    """The (2 sigma)^2 terms of eq. 11.

    One residual (x - mean) 2 / sqrt(n - 1) per pose and coordinate has the same sum of squares
    as one 2 sigma per sphere and coordinate, but no square root that stalls near zero.
    """
    weight = repeatability_weights(sums)
    return Quadratic(
        float(weight @ sums.spread.sum(axis=1)),
        weight @ sums.gradient,
        np.einsum('s,sfg->fg', weight, sums.normal),
        float(3 * np.maximum(sums.count - 1, 0).sum()),
    )


def distance_repeatability(problem: Problem, sums: SphereSums) -> Quadratic:
    """Eq. 11: distance errors and twice the standard deviations together."""
    return distance(problem, sums) + repeatability(problem, sums)


def position(problem: Problem, sums: SphereSums) -> Quadratic:
    """Eq. 10: squared distances to the certificate's points, each location's placement free.

    The placements are eliminated: at the best one, what a rigid motion of the gauge could still
    take up is projected out of the Jacobian (variable projection).
    """
    total = Quadratic(
        float(sums.spread.sum()),
        sums.gradient.sum(axis=0),
        sums.normal.sum(axis=0),
        float(3 * np.maximum(sums.count - 1, 0).sum()),
    )
    for rows in problem.placements:
        fitted = fit_placement(problem, sums, rows)
        residual, slope = fitted.residual, fitted.slope
        total += Quadratic(
            float(residual @ residual), slope.T @ residual, slope.T @ slope, fitted.terms
        )
    return total


@dataclass(frozen=True)
class FittedPlacement:
    """The certificate laid over k spheres: weighted `residual` (3k,) and `slope` (3k, F) less what
    the placement takes up, the `rotation` (3, 3) it stands at, and the residuals left, `terms`."""

    residual: Array
    slope: Array
    rotation: Array
    terms: int


def fit_placement(problem: Problem, sums: SphereSums, rows: IntArray) -> FittedPlacement:
    """The best placement of the certificate on the spheres `rows` of one location."""
    gauge = problem.measured.gauge
    certified = np.array([gauge.center(int(number)) for number in problem.keys[rows, 1]])
    weight = np.sqrt(sums.count[rows])
    placed = place_gauge(certified, sums.center[rows], sums.count[rows])
    residual: Array = (weight[:, None] * (sums.center[rows] - placed.points)).reshape(-1)
    slope = (weight[:, None, None] * sums.jacobian[rows]).reshape(len(residual), -1)
    motion = (weight[:, None, None] * placed.motion).reshape(-1, 6)
    u, values, _ = np.linalg.svd(motion, full_matrices=False)
    basis = u[:, values > 1e-9 * max(values[0], 1e-300)]
    return FittedPlacement(
        residual - basis @ (basis.T @ residual),
        slope - basis @ (basis.T @ slope),
        placed.rotation,
        max(len(residual) - basis.shape[1], 0),
    )


Objective = Callable[[Problem, SphereSums], Quadratic]
OBJECTIVES: dict[str, Objective] = {
    'distance_repeatability': distance_repeatability,
    'distance': distance,
    'position': position,
}


def objective(name: str) -> Objective:
    """The objective of a name.

    Raises:
        DataError: there is none; the message lists those there are.
    """
    if name not in OBJECTIVES:
        raise DataError(f'no objective {name!r}: expected one of {", ".join(OBJECTIVES)}')
    return OBJECTIVES[name]
