# SPDX-License-Identifier: Apache-2.0
"""The quantities of ISO 10360-12 and ISO 9283, computed from the poses of a probing set.

A self-centering probe gives the centre of a sphere with each pose, so every pose of a sphere is one
articulation. Lengths between single poses of two spheres are probed from either side alike, which
is what the standard calls unidirectional. None of this is a test after a standard: these prescribe
the artefacts, where they stand, the points, the speed and the load.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_solver.quality.assessment import Quality
from calib_solver.quality.measuring_arm import lengths

STANDARDS_BASIS = (
    'as defined in ISO 10360-12 and ISO 9283, computed from probing poses; not a test by them'
)
#: a point is on a sphere that misses it by this part of the radius
ON = 1e-10
#: the smallest sphere is held by at most four points; with the one outside it they are this many
MOST = 5
PAIRS = np.array(list(combinations(range(MOST - 1), 2)))
TRIPLES = np.array(list(combinations(range(MOST - 1), 3)))
#: the points that may hold it (14, MOST): the last with one, two or three of the others
HOLDING = np.array(
    [
        [row in others or row == MOST - 1 for row in range(MOST)]
        for size in (1, 2, 3)
        for others in combinations(range(MOST - 1), size)
    ]
)


@dataclass(frozen=True)
class StandardFigures:
    """By probed sphere (S,), m, NaN where there are too few poses or spheres: `location_error` is
    the diameter of the smallest sphere around its poses' centres, `accuracy` AP the distance of
    their mean from the certificate as placed, `repeatability` RP = mean + 3 s of the poses'
    distances from it. By certified distance (M,): AD the `distance_accuracy` of the mean of single
    distances, RD their `distance_repeatability` 3 s."""

    location_error: Array
    accuracy: Array
    repeatability: Array
    distance_accuracy: Array
    distance_repeatability: Array


def standard_figures(quality: Quality) -> StandardFigures:
    """The quantities of all spheres and distances."""
    count = quality.spheres.poses
    start = np.concatenate([[0], np.cumsum(count)])
    location_error = np.where(count > 1, 2 * enclosing_radii(quality.deviation, count), np.nan)
    repeatability = np.full(len(count), np.nan)
    for row in np.flatnonzero(count > 1):
        away = np.linalg.norm(quality.deviation[start[row] : start[row + 1]], axis=1)
        repeatability[row] = away.mean() + 3 * away.std(ddof=1)
    found = lengths(quality)
    pairs = len(quality.pairs)
    many = np.bincount(found.pair, minlength=pairs)
    means = np.bincount(found.pair, found.deviation, pairs) / np.maximum(many, 1)
    squares = np.bincount(found.pair, (found.deviation - means[found.pair]) ** 2, pairs)
    spreads = np.where(many > 1, 3 * np.sqrt(squares / np.maximum(many - 1, 1)), np.nan)
    return StandardFigures(location_error, quality.displaced, repeatability, means, spreads)


def enclosing_radii(points: Array, count: NDArray[np.int64]) -> Array:
    """The radius (S,) of the smallest sphere around each run of `count` (S,) of points (P, 3), in
    their unit.

    The sphere around a few of them grows by the point that is farthest outside until none is: each
    time the smallest one around those few and the new one is sought among all spheres through two
    to four of them.
    """
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    run = np.repeat(np.arange(len(count)), count)
    center, radius = points[start], np.zeros(len(count))
    held = np.repeat(center[:, None], MOST, axis=1)
    for _ in range(10 * int(np.max(count))):
        away = np.linalg.norm(points - center[run], axis=1)
        farthest = np.maximum.reduceat(away, start)
        growing = np.flatnonzero(farthest > radius * (1 + ON))
        if not len(growing):
            break
        outside = np.flatnonzero(away == farthest[run])
        held[growing, -1] = points[outside[np.searchsorted(run[outside], growing)]]
        held[growing], center[growing], radius[growing] = _smallest(held[growing])
    return radius


def _smallest(points: Array) -> tuple[Array, Array, Array]:
    """Of each five points (G, 5, 3) those that hold their smallest sphere, the last of them in
    place of the rest; its centre (G, 3) and radius (G,). The last, outside the smallest sphere
    around the others, is one of them."""
    last = points[:, -1:]
    centers = last + _through(points[:, :-1] - last)
    away = np.linalg.norm(points[:, None] - centers[:, :, None], axis=-1)
    radius = np.where(HOLDING, away, 0.0).max(axis=-1)
    # not where points in a line or a plane have none: NaN is not within
    radius[~(away.max(axis=-1) <= radius * (1 + ON))] = np.inf
    best, row = np.argmin(radius, axis=1), np.arange(len(points))
    held = np.where(HOLDING[best][..., None], points, last)
    return held, centers[row, best], radius[row, best]


def _through(edges: Array) -> Array:
    """From a point to the centres (G, 14, 3) of the smallest spheres through it and the one, two
    or three others that edges (G, 4, 3) lead to, as HOLDING lists them."""
    square = (edges**2).sum(axis=-1, keepdims=True)
    a, b = edges[:, PAIRS[:, 0]], edges[:, PAIRS[:, 1]]
    normal = np.cross(a, b)
    turned = np.cross(square[:, PAIRS[:, 0]] * b - square[:, PAIRS[:, 1]] * a, normal)
    c, d, e = (edges[:, TRIPLES[:, k]] for k in range(3))
    first, second, third = (square[:, TRIPLES[:, k]] for k in range(3))
    across = np.cross(d, e)
    weighted = first * across + second * np.cross(e, c) + third * np.cross(c, d)
    with np.errstate(divide='ignore', invalid='ignore'):
        of_pairs = turned / (2 * (normal**2).sum(axis=-1, keepdims=True))
        of_triples = weighted / (2 * (c * across).sum(axis=-1, keepdims=True))
    return np.concatenate([edges / 2, of_pairs, of_triples], axis=1)
