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

from calib_model.arrays import Array
from calib_solver.quality.assessment import Quality
from calib_solver.quality.measuring_arm import lengths

STANDARDS_BASIS = (
    'as defined in ISO 10360-12 and ISO 9283, computed from probing poses; not a test by them'
)
#: a point is on a sphere that misses it by this part of the radius
ON = 1e-10


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
    location_error, repeatability = np.full((2, len(count)), np.nan)
    for row in np.flatnonzero(count > 1):
        own = quality.deviation[start[row] : start[row + 1]]
        away = np.linalg.norm(own, axis=1)
        location_error[row] = 2 * enclosing_radius(own)
        repeatability[row] = away.mean() + 3 * away.std(ddof=1)
    found = lengths(quality)
    pairs = len(quality.pairs)
    many = np.bincount(found.pair, minlength=pairs)
    means = np.bincount(found.pair, found.deviation, pairs) / np.maximum(many, 1)
    squares = np.bincount(found.pair, (found.deviation - means[found.pair]) ** 2, pairs)
    spreads = np.where(many > 1, 3 * np.sqrt(squares / np.maximum(many - 1, 1)), np.nan)
    return StandardFigures(location_error, quality.displaced, repeatability, means, spreads)


def enclosing_radius(points: Array) -> float:
    """The radius of the smallest sphere around points (N, 3), in their unit.

    The sphere around a few of them grows by the point that is farthest outside until none is: each
    time the smallest one around those few and the new one is sought among all spheres through two
    to four of them.
    """
    support = points[:1]
    center, radius = points[0], 0.0
    for _ in range(10 * len(points)):
        away = np.linalg.norm(points - center, axis=1)
        farthest = int(np.argmax(away))
        if away[farthest] <= radius * (1 + ON):
            break
        support = np.concatenate([support, points[farthest : farthest + 1]])
        support, center, radius = _smallest(support)
    return radius


def _smallest(points: Array) -> tuple[Array, Array, float]:
    """Of up to five points those that hold their smallest sphere, its centre and radius. The last,
    outside the smallest sphere around the others, is one of them."""
    best, last = (points, points.mean(axis=0), np.inf), len(points) - 1
    for size in (1, 2, 3):
        for rows in combinations(range(last), size):
            held = points[[*rows, last]]
            center, radius = _through(held)
            around = np.linalg.norm(points - center, axis=1).max() <= radius * (1 + ON)
            if around and radius < best[2]:
                best = (held, center, radius)
    return best


def _through(points: Array) -> tuple[Array, float]:
    """The smallest sphere through all of two to four points."""
    edges = points[1:] - points[0]
    # its centre is in the points' own plane, and as far from all of them
    offset = np.linalg.lstsq(edges, (edges**2).sum(axis=1) / 2, rcond=1e-12)[0]
    return points[0] + offset, float(np.linalg.norm(points - points[0] - offset, axis=1).max())
