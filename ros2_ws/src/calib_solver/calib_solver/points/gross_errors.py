# SPDX-License-Identifier: Apache-2.0
"""Points that do not belong: a beam that was broken, a reflector that was knocked, a wrong row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, median
from calib_solver.fitting import USUAL_PRIOR, Descent, Options, Prior
from calib_solver.points.places import Flange
from calib_solver.points.problem import PointProblem
from calib_solver.points.quality import LEAST_SIZE, SOFT_ROUNDS, soft_trust
from calib_solver.points.solver import PointSolver

#: a point this many times further out than the median does not belong: normal noise in space gets
#: there once in ten million points
FAR = 4.5
ROUNDS = 12
#: more left out than this part is no matter of single points
MANY = 0.1
#: usual widths, but weak: a start far off is no reason to stay there
WEAK = 10.0

POSITION = 'away from where the other points put it: a broken beam, a knocked or another target'
ORIENTATION = 'turned away from what the other points say: a misread orientation'


@dataclass(frozen=True)
class RejectedPoint:
    """A point left out: `pose`, its number in the measurement, from 1, how far off it was (m), by
    which angle (rad) where its orientation was."""

    pose: int
    target: str
    station: int
    size: float
    angle: float | None
    reason: str


@dataclass(frozen=True)
class CleanPoints:
    """The problem without what does not belong, and where the fits that judged it ended."""

    problem: PointProblem
    rejected: tuple[RejectedPoint, ...]
    descent: Descent

    @property
    def warnings(self) -> tuple[str, ...]:
        """A line where so many were left out that they are no matter of single points."""
        count = len(self.rejected)
        total = len(self.problem) + count
        if count <= MANY * total:
            return ()
        return (
            f'{count} of {total} points lie far from where the others put them and were left out: '
            'is a station or a target another one than its number says, or a joint counted '
            'otherwise?',
        )


def without_gross_points(problem: PointProblem, solver: PointSolver) -> CleanPoints:
    """Leave out gross errors, judged against the median by fits that give less weight to what
    stands out, until what is left out no longer changes."""
    prior = solver.options.prior
    firm = prior if prior.strength == 0 or not prior.evidence else _weak()
    judge = PointSolver(solver.table, Options('position', prior=firm))
    judge.begin_at(solver.places(problem, np.zeros(len(solver.nominal))))
    descent = Descent(np.zeros(len(solver.nominal)))
    kept: NDArray[np.bool_] = np.ones(len(problem), dtype=np.bool_)
    current, bent = problem, False
    rejecting = solver.options.loss == 'rejecting'
    for number in range(ROUNDS):
        fit, descent = judge.solve(current, descent)
        places = judge.places(current, fit.x)
        flange = Flange.of(problem, judge.table, judge.full(fit.x))
        away, turn = flange.residuals(problem, places)
        distance = np.sqrt(problem.weight) * np.linalg.norm(away, axis=1)
        angle = np.linalg.norm(turn, axis=1)
        out, turned, turn_weight = _how_far(problem, distance, angle, kept)
        far = np.maximum(out, turned)
        now = far <= FAR if rejecting else np.ones(len(problem), dtype=np.bool_)
        bent = bent or not now.all()
        change = abs(np.log(turn_weight / current.turn_weight))
        settled = np.array_equal(now, kept) and change < 0.1
        kept = now
        soft = bent and number < SOFT_ROUNDS
        if settled and not soft:
            break
        trust = kept.astype(float)
        if soft:
            trust *= soft_trust(far)
        current = problem.trusting(trust).turns_weighing(turn_weight)
    clean = problem.turns_weighing(current.turn_weight)
    if not kept.all():
        clean = clean.only(kept)
    rejected = [
        RejectedPoint(
            int(problem.order[row]) + 1,
            problem.targets[problem.target[row]],
            problem.stations[problem.station[row]],
            float(np.linalg.norm(away[row])),
            float(angle[row]) if problem.oriented[row] else None,
            POSITION if out[row] > FAR else ORIENTATION,
        )
        for row in np.flatnonzero(~kept)
    ]
    solver.begin_at(places)
    return CleanPoints(clean, tuple(sorted(rejected, key=lambda one: one.pose)), descent)


def _weak() -> Prior:
    return Prior(USUAL_PRIOR.sigma, 1 / WEAK**2)


def _how_far(
    problem: PointProblem, distance: Array, angle: Array, kept: NDArray[np.bool_]
) -> tuple[Array, Array, float]:
    """How many times the median each position and rotation is out (N,), and what a squared
    rotation (rad^2) is worth in squared lengths (m^2)."""
    usual = max(float(median(distance[kept])), LEAST_SIZE / FAR)
    turned = problem.oriented > 0
    if not turned.any():
        return distance / usual, np.zeros(len(distance)), problem.turn_weight
    usual_turn = max(float(median(angle[turned & kept])), LEAST_SIZE / FAR)
    return distance / usual, angle / usual_turn, (usual / usual_turn) ** 2
