# SPDX-License-Identifier: Apache-2.0
"""The arm as a measuring arm: the quantities in which ASME B89.4.22 states an arm's performance.

The standard tests an arm on a seat (single-point articulation) and on calibrated lengths held in
many places of the volume (volumetric performance). The same quantities are computed here from the
poses of a probing set: a probed sphere is the seat, two spheres of the gauge are the length. That
says what the arm would show in such tests; it is no test by the standard, which prescribes the
seats, the lengths, where they stand and how often they are taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_solver.problem import IntArray
from calib_solver.quality.assessment import Quality

BASIS = 'computed from the poses given, measured or simulated; not a test by the standard'


@dataclass(frozen=True)
class Articulation:
    """Single-point articulation at K spheres with more than one pose, rows `sphere` (K,) of the
    quality's spheres: `points` (K,) taken, `max_deviation` (K,) of a point from their mean, m, and
    `two_s` (K,), m: 2 sqrt(sum(deviation^2) / (points - 1)), deviations as distances in space."""

    sphere: IntArray
    points: IntArray
    max_deviation: Array
    two_s: Array


@dataclass(frozen=True)
class Lengths:
    """L lengths between single probings of two spheres, rows `pair` (L,) of the quality's pairs:
    `deviation` (L,) of each from the certificate, with its sign, m."""

    pair: IntArray
    deviation: Array

    @property
    def two_rms(self) -> float:
        """Twice the root mean square of the deviations, m."""
        return float(2 * np.sqrt(np.mean(self.deviation**2)))

    @property
    def span(self) -> float:
        """From the smallest to the largest deviation, m."""
        return float(self.deviation.max() - self.deviation.min())


def articulation(quality: Quality) -> Articulation:
    """How far the points on each seat are from their mean, as distances in space."""
    count = quality.spheres.poses
    size = np.linalg.norm(quality.deviation, axis=1)
    start = np.concatenate([[0], np.cumsum(count)[:-1]])
    sphere = np.flatnonzero(count > 1)
    if len(size) == 0:
        return Articulation(sphere, count[sphere], size, size)
    farthest = np.maximum.reduceat(size, start)[sphere]
    squares = np.add.reduceat(size**2, start)[sphere]
    two_s = 2 * np.sqrt(squares / (count[sphere] - 1))
    return Articulation(sphere, count[sphere], farthest, two_s)


def lengths(quality: Quality) -> Lengths:
    """Every certified distance measured with single poses: the first pose of one sphere against
    the first of the other, the second against the second, while both have one."""
    count, center = quality.spheres.poses, quality.spheres.center
    start = np.concatenate([[0], np.cumsum(count)])
    rows, deviations = [], []
    for row, (first, second) in enumerate(quality.pairs):
        both = int(min(count[first], count[second]))
        one = quality.deviation[start[first] : start[first] + both]
        other = quality.deviation[start[second] : start[second] + both]
        measured = np.linalg.norm(center[first] - center[second] + one - other, axis=1)
        deviations.append(measured - quality.nominal[row])
        rows.append(np.full(both, row, dtype=np.int64))
    if not rows:
        return Lengths(np.zeros(0, dtype=np.int64), np.zeros(0))
    return Lengths(np.concatenate(rows), np.concatenate(deviations))
