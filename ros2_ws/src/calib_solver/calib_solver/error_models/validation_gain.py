# SPDX-License-Identifier: Apache-2.0
"""What columns added to a model are worth on gauge locations that their fit has not seen.

All are small beside the model they are added to, so that one pass over the poses, linear about
the identified parameters, tells every candidate's fit without every location.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting import (
    Quadratic,
    distance_errors,
    linear_step,
    objective,
    repeatability_weights,
)
from calib_solver.problem import Folds, IntArray, Problem, SphereSums

#: fewer locations than this do not tell gain from luck
FEWEST_LOCATIONS = 4
#: nothing is added for less than this part of the error
LEAST_GAIN = 0.02
#: nor for a gain that is less than this many standard errors (Student, 97.5 %), by folds from 4 on
SURE = (3.18, 2.78, 2.57, 2.45, 2.36, 2.31, 2.26)
ROUNDING = 1e-12


@dataclass(frozen=True)
class Gain:
    """By which factor the rms of what was left out changes, as the mean of its logarithm over the
    `folds`, `change`, with that mean's `standard_error`, and of the fold that does worst, `worst`;
    `before` and `after` are the rms, m."""

    change: float
    standard_error: float
    before: float
    after: float
    folds: int
    worst: float = 0.0

    @classmethod
    def of(cls, own: Array, other: Array) -> Gain:
        """Of mean squares `own` (K,), m^2, over `other` ones on the same K folds."""
        change = 0.5 * np.log((own + ROUNDING**2) / (other + ROUNDING**2))
        error = change.std(ddof=1) / np.sqrt(len(change))
        return cls(
            float(change.mean()),
            float(error),
            float(np.sqrt(other.mean())),
            float(np.sqrt(own.mean())),
            len(change),
            float(change.max()),
        )

    @property
    def harmless(self) -> bool:
        """Whether no location that is left out gets worse."""
        return self.worst <= 0

    @property
    def convinces(self) -> bool:
        """Whether it is more than chance, and worth while."""
        sure = SURE[self.folds - FEWEST_LOCATIONS] * self.standard_error
        least = max(sure, -np.log(1 - LEAST_GAIN))
        return bool(-self.change > least)

    @property
    def ratio(self) -> float:
        """The factor itself, the geometric mean over the folds."""
        return float(np.exp(self.change))

    @property
    def words(self) -> str:
        """The change in per cent."""
        percent = 100 * (self.ratio - 1)
        return f'{percent:+.1f} % (standard error {100 * self.standard_error:.1f} %)'


@dataclass(frozen=True)
class Scores:
    """Sums of squares over each of K folds (K,), m^2, and how many terms they are: of 2 sigma
    (eq. 8) and of the distance errors (eq. 7)."""

    two_sigma: Array
    sigma_terms: Array
    distance: Array
    distance_terms: Array

    @property
    def mean_square(self) -> Array:
        """Of all of eq. 11's terms, by fold."""
        terms = np.maximum(self.sigma_terms + self.distance_terms, 1)
        mean: Array = (self.two_sigma + self.distance) / terms
        return mean

    @property
    def two_sigma_rms(self) -> float:
        """Over all folds, m."""
        return float(np.sqrt(self.two_sigma.sum() / max(self.sigma_terms.sum(), 1)))

    @property
    def distance_rms(self) -> float:
        """Over all folds, m."""
        return float(np.sqrt(self.distance.sum() / max(self.distance_terms.sum(), 1)))

    def against(self, without: Scores) -> Gain:
        """The gain over other scores on the same folds."""
        return Gain.of(self.mean_square, without.mean_square)


class LeaveOneOut:
    """Fits of some columns of a problem's sums to all gauge locations but some, and their worth.

    `folds` say which locations are left out together; `sums` are those at the parameters that all
    is linear about; the objective `name` is minimised with `kappa` (m^2) the weight of the prior.
    """

    def __init__(self, folds: Folds, sums: SphereSums, name: str, kappa: float) -> None:
        self.problem: Problem = folds.problem
        self.sums = sums
        self.kappa = kappa
        minimised = objective(name)
        self.folds = folds.rows
        self.whole = minimised(self.problem, sums)
        self._without = [minimised(*part) for part in folds.without(sums)]
        self._error, self._slope = distance_errors(self.problem, sums)

    def fit(self, columns: IntArray, information: Array, about: Array, where: Quadratic) -> Array:
        """The step (F,) by `columns`, zero in the others, to the minimum of `where`.

        `information` (F,) is that of the prior, about offsets -`about` (F,) from here.
        """
        step = np.zeros(len(where.gradient))
        step[columns] = linear_step(
            where.normal[np.ix_(columns, columns)],
            where.gradient[columns],
            self.kappa * information[columns],
            about[columns],
        )
        return step

    def scores(self, columns: IntArray, information: Array, about: Array) -> Scores:
        """Every fold as the fit without it predicts it."""
        found = [
            self._score(fold, self.fit(columns, information, about, where))
            for fold, where in zip(self.folds, self._without, strict=True)
        ]
        return Scores(*np.array(found).T)

    def _score(self, fold: IntArray, step: Array) -> tuple[float, float, float, float]:
        sums, pairs = self.sums, np.isin(self.problem.pairs, fold).any(axis=1)
        error = self._error[pairs] + self._slope[pairs] @ step
        weight = repeatability_weights(sums)[fold]
        bent = np.einsum('f,sfg,g->s', step, sums.normal[fold], step)
        spread = sums.spread[fold].sum(axis=1) + 2 * sums.gradient[fold] @ step + bent
        return (
            float(weight @ np.maximum(spread, 0.0)),
            3.0 * int((weight > 0).sum()),
            float(error @ error),
            float(len(error)),
        )
