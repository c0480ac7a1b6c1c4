# SPDX-License-Identifier: Apache-2.0
"""How good a set of parameters is on a set of poses: the chapter's Fig. 6, and contract's Q."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, lengths
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import CorrectedArm, Correction, points_of_turned
from calib_solver.problem import IntArray, Problem, place_gauge

COORDINATES = ('x', 'y', 'z')


@dataclass(frozen=True)
class ProbedSpheres:
    """S probed spheres: `keys` (S, 2) location and sphere, `poses` (S,), `center` (S, 3) in m,
    `two_sigma` (S, 3) in m (eq. 8; NaN where there is a single pose)."""

    keys: IntArray
    poses: IntArray
    center: Array
    two_sigma: Array


@dataclass(frozen=True)
class Quality:
    """Distance errors `distance` (M,) of eq. 7 for `pairs` (M, 2) rows of `spheres.keys` with
    certified lengths `nominal` (M,); `deviation` (N, 3) of each pose from its sphere's mean, in the
    problem's order (eq. 12 with the other sign), and `position` (N,): each pose's distance to the
    certificate after a best-fit placement; `displaced` (S,) is each sphere's mean's distance to it,
    NaN where no other sphere stood there; all in m."""

    spheres: ProbedSpheres
    pairs: IntArray
    nominal: Array
    distance: Array
    deviation: Array
    position: Array
    displaced: Array

    @property
    def points(self) -> Array:
        """`p_base` (N, 3) of each pose, in the problem's order, m."""
        found: Array = np.repeat(self.spheres.center, self.spheres.poses, axis=0) + self.deviation
        return found

    @property
    def spread(self) -> float:
        """The usual distance of a pose from its sphere's centre, m: the rms."""
        return float(np.sqrt((self.deviation**2).sum(axis=1).mean()))

    @property
    def phi(self) -> float:
        """Eq. 11 as the chapter counts it, m^2."""
        known = self.spheres.two_sigma[np.isfinite(self.spheres.two_sigma)]
        return float(self.distance @ self.distance + known @ known)


def probed_points(
    problem: Problem, arm: Arm, probe: Probe, correction: Correction | None = None
) -> Array:
    """`p_base` (N, 3) of every pose, in the problem's order, m: eq. 14, corrected where wanted."""
    p_flange = probe.flange_T_probe.apply(problem.centers)
    if correction is None:
        return points_of_turned(arm, problem.cosine, problem.sine, problem.slide, p_flange)
    return CorrectedArm(arm, correction).points(problem.joints, p_flange)


def assess(
    problem: Problem, arm: Arm, probe: Probe, correction: Correction | None = None
) -> Quality:
    """The quality of `arm` with `probe` on the poses of a problem, corrected where wanted."""
    p_base = probed_points(problem, arm, probe, correction)
    count, start = problem.counts, problem.start[:-1]
    nearby = p_base[start]
    away = p_base - np.repeat(nearby, count, axis=0)
    mean = np.add.reduceat(away, start, axis=0) / count[:, None]
    center = nearby + mean
    deviation = away - np.repeat(mean, count, axis=0)
    two_sigma = np.full(center.shape, np.nan)
    several = count > 1
    squares = np.add.reduceat(deviation**2, start, axis=0)[several]
    two_sigma[several] = 2 * np.sqrt(squares / (count[several, None] - 1))
    first, second = problem.pairs.T
    measured = np.linalg.norm(center[first] - center[second], axis=1)
    return Quality(
        ProbedSpheres(problem.keys, count, center, two_sigma),
        problem.pairs,
        problem.nominal,
        np.abs(measured - problem.nominal),
        deviation,
        *_position_errors(problem, p_base, center),
    )


def _position_errors(problem: Problem, p_base: Array, center: Array) -> tuple[Array, Array]:
    """Of each pose (N,), and of the mean of each sphere (S,)."""
    gauge = problem.measured.gauge
    certified = np.array([gauge.center(int(number)) for number in problem.keys[:, 1]])
    points, displaced = np.empty_like(center), np.full(len(center), np.nan)
    for rows in problem.placements:
        placed = place_gauge(certified[rows], center[rows], problem.counts[rows].astype(float))
        points[rows] = placed.points
        if len(rows) > 1:
            displaced[rows] = np.linalg.norm(center[rows] - placed.points, axis=1)
    errors = lengths(p_base - np.repeat(points, problem.counts, axis=0))
    return errors, displaced
