# SPDX-License-Identifier: Apache-2.0
"""Residuals to look at: how far every pose is off its sphere's centre, before and after."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm
from calib_model.kinematics import Correction
from calib_solver.points import PointIdentification, PointQuality, flange_of
from calib_solver.problem import Problem
from calib_solver.quality import Quality

Color = tuple[float, float, float, float]
RED: Color = (0.9, 0.2, 0.1, 0.8)
GREEN: Color = (0.2, 0.7, 0.3, 0.9)
SHOWN = 20_000  # poses: more tell an eye no more, and take a viewer long


@dataclass(frozen=True)
class Residuals:
    """Lines, `points` (2K, 3) in m by twos, of one color (RGBA from 0 to 1): from each sphere's
    centre to where its poses would be, had they missed it `magnification` times as far."""

    name: str
    points: Array
    color: Color


def residuals(
    problem: Problem, initial: Quality, identified: Quality, magnification: float
) -> tuple[Residuals, Residuals]:
    """Before (red) and after (green) an identification, in the frame of the arm's base."""
    return (
        Residuals('before', _lines(problem, initial, magnification), RED),
        Residuals('after', _lines(problem, identified, magnification), GREEN),
    )


def point_residuals(done: PointIdentification, magnification: float) -> tuple[Residuals, Residuals]:
    """The same of measured points: from each to where its target is predicted."""

    def lines(quality: PointQuality, arm: Arm, correction: Correction | None = None) -> Array:
        points = flange_of(done.problem, arm, correction).points(done.problem, quality.places)
        return _between(points - quality.position, quality.position, magnification)

    return (
        Residuals('before', lines(done.initial, done.problem.arm), RED),
        Residuals('after', lines(done.identified, done.arm, done.correction), GREEN),
    )


def _lines(problem: Problem, quality: Quality, magnification: float) -> Array:
    of_pose = np.empty(len(quality.deviation), np.int64)
    for sphere in range(len(problem.counts)):
        of_pose[problem.rows(sphere)] = sphere
    return _between(quality.spheres.center[of_pose], quality.deviation, magnification)


def _between(begin: Array, away: Array, magnification: float) -> Array:
    every = max(1, -(-len(begin) // SHOWN))
    begin = begin[::every]
    ends = begin + magnification * away[::every]
    return frozen(np.stack([begin, ends], axis=1).reshape(-1, 3))
