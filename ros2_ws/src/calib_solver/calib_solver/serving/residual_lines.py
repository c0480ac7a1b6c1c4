# SPDX-License-Identifier: Apache-2.0
"""Residuals to look at: how far every pose is off its sphere's centre, before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm
from calib_model.kinematics import Correction
from calib_solver.identified import Identification
from calib_solver.points import PointIdentification, PointQuality, flange_of
from calib_solver.problem import Problem
from calib_solver.quality import Quality

Color = tuple[float, float, float, float]
RED: Color = (0.9, 0.2, 0.1, 0.8)
GREEN: Color = (0.2, 0.7, 0.3, 0.9)
SHOWN = 20_000  # poses: more tell an eye no more, and take a viewer long


@dataclass(frozen=True)
class Residuals:
    """`center` (K, 3) of each pose's sphere and the pose's `deviation` (K, 3) from it, m in the
    frame of the arm's base, to be shown in one color (RGBA from 0 to 1)."""

    name: str
    center: Array
    deviation: Array
    color: Color

    def lines(self, magnification: float) -> Array:
        """Points (2K, 3) in m, by twos a line: from each sphere's centre to where its poses would
        be, had they missed it `magnification` times as far."""
        ends = self.center + magnification * self.deviation
        return frozen(np.stack([self.center, ends], axis=1).reshape(-1, 3))


def residuals(done: Identification) -> tuple[Residuals, Residuals]:
    """Before (red) and after (green) an identification."""
    return (
        _of('before', done.problem, done.initial, RED),
        _of('after', done.problem, done.identified, GREEN),
    )


def point_residuals(done: PointIdentification) -> tuple[Residuals, Residuals]:
    """The same of measured points: from each to where its target is predicted."""

    def shown(
        name: str,
        color: Color,
        quality: PointQuality,
        arm: Arm,
        correction: Correction | None = None,
    ) -> Residuals:
        points = flange_of(done.problem, arm, correction).points(done.problem, quality.places)
        return _thinned(name, points - quality.position, quality.position, color)

    return (
        shown('before', RED, done.initial, done.problem.arm),
        shown('after', GREEN, done.identified, done.arm, done.model),
    )


def _of(name: str, problem: Problem, quality: Quality, color: Color) -> Residuals:
    of_pose = np.empty(len(quality.deviation), np.int64)
    for sphere in range(len(problem.counts)):
        of_pose[problem.rows(sphere)] = sphere
    return _thinned(name, quality.spheres.center[of_pose], quality.deviation, color)


def _thinned(name: str, center: Array, deviation: Array, color: Color) -> Residuals:
    every = max(1, -(-len(center) // SHOWN))
    return Residuals(name, frozen(center[::every]), frozen(deviation[::every]), color)
