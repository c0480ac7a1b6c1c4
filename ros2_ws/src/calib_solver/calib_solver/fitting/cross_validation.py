# SPDX-License-Identifier: Apache-2.0
"""How much to trust the prior: the strength that predicts gauge locations left out best."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import DataError
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.levenberg_marquardt import minimise
from calib_solver.fitting.objectives import (
    Quadratic,
    distance_errors,
    objective,
    repeatability_weights,
)
from calib_solver.fitting.prior import Prior
from calib_solver.problem import IntArray, Problem, SphereSums, accumulate, gathered, take_groups

#: more locations than this are left out several at a time
MOST_FOLDS = 10
#: differences of scores below this (m) are rounding, not quality
LEAST_SCORE = 1e-9
#: a standard error from fewer folds is itself too unsure to go by
FEWEST_FOLDS = 5


@dataclass(frozen=True)
class Tried:
    """A strength with its `score`, the rms over what was left out of eq. 11's terms (m), and
    `behind`: how much worse than the best it is, as the mean over the folds of the logarithm of
    their scores' ratio, with that mean's `standard_error`."""

    strength: float
    score: float
    behind: float
    standard_error: float


@dataclass(frozen=True)
class CrossValidation:
    """The strengths that were tried and the one `chosen`; `folds` parts, whole `left_out`
    ('locations' or 'spheres'), were each predicted from the others."""

    tried: tuple[Tried, ...]
    chosen: float
    folds: int
    left_out: str


def choose_strength(
    problem: Problem,
    table: ParameterTable,
    name: str,
    prior: Prior,
    start: Array,
    least_noise: float = 0.0,
) -> CrossValidation:
    """The strength among `prior.candidates` that predicts best what the fit has not seen.

    Each fold's locations are left out in turn, the objective `name` is minimised over the others
    from offsets `start` (F,), and eq. 11's terms of what was left out are its score;
    `least_noise` (m^2) is that of `levenberg.minimise`. Chosen is the strongest prior that is not
    worse than the best by more than one standard error. That error is of the difference, location
    by location: how hard the locations are differs far more than how well two priors do at each
    of them. With fewer than five folds it says nothing, and the best one is taken. With one
    location the same is done over its spheres.

    Raises:
        DataError: there is one sphere only, or what is left tells nothing.
    """
    folds, left_out = _folds(problem)
    nominal = table.nominal[table.free_columns]
    scores = np.empty((len(prior.candidates), len(folds)))
    for j, fold in enumerate(folds):
        evaluate = _cost(_without(problem, fold), table, name, nominal)
        if evaluate(start).terms == 0:
            raise DataError(
                f'{problem.measured.source}: the prior cannot be chosen by cross-validation: '
                f'objective {name} has no terms once a part of the {left_out} is left out'
            )
        for i, strength in enumerate(prior.candidates):
            information = Prior(prior.sigma, strength).information(table)
            fit = minimise(evaluate, start, prior.sigmas(table), information, least_noise)
            sums = accumulate(problem, table, table.full(nominal + fit.x))
            scores[i, j] = _mean_square(problem, sums, fold)
    return _chosen(prior.candidates, scores, left_out)


def _folds(problem: Problem) -> tuple[list[IntArray], str]:
    """Rows of `problem.keys` to leave out together."""
    groups, left_out = problem.locations, 'locations'
    if len(groups) < 2:
        groups, left_out = [np.array([s]) for s in range(len(problem.keys))], 'spheres'
    if len(groups) < 2:
        raise DataError(
            f'{problem.measured.source}: the prior cannot be chosen by cross-validation: '
            'there is one sphere only, expected two locations or two spheres'
        )
    count = min(len(groups), MOST_FOLDS)
    return [np.sort(np.concatenate(groups[i::count])) for i in range(count)], left_out


def _without(problem: Problem, fold: IntArray) -> Problem:
    kept = np.setdiff1d(np.arange(len(problem.keys)), fold)
    return take_groups(problem, gathered(problem, kept))


def _cost(
    problem: Problem, table: ParameterTable, name: str, nominal: Array
) -> Callable[[Array], Quadratic]:
    cost = objective(name)
    return lambda x: cost(problem, accumulate(problem, table, table.full(nominal + x)))


def _mean_square(problem: Problem, sums: SphereSums, fold: IntArray) -> float:
    """Mean square (m^2) of eq. 11's terms that the spheres of a fold have part in."""
    error, _ = distance_errors(problem, sums)
    error = error[np.isin(problem.pairs, fold).any(axis=1)]
    weight = repeatability_weights(sums)[fold]
    spread = weight[:, None] * np.maximum(sums.spread[fold], 0.0)
    terms = len(error) + 3 * int((weight > 0).sum())
    return (float(error @ error) + float(spread.sum())) / max(terms, 1)


def _chosen(strengths: tuple[float, ...], scores: Array, left_out: str) -> CrossValidation:
    """The one-standard-error rule on scores (strengths, folds), m^2."""
    logarithm = 0.5 * np.log(scores + LEAST_SCORE**2)
    best = int(np.argmin(logarithm.mean(axis=1)))
    behind = logarithm - logarithm[best]
    folds = scores.shape[1]
    error = behind.std(axis=1, ddof=1) / np.sqrt(folds)
    mean = behind.mean(axis=1)
    tried = tuple(
        Tried(strength, float(np.sqrt(scores[i].mean())), float(mean[i]), float(error[i]))
        for i, strength in enumerate(strengths)
    )
    if folds < FEWEST_FOLDS:
        return CrossValidation(tried, strengths[best], folds, left_out)
    fair = [one.strength for one in tried if one.behind <= one.standard_error]
    return CrossValidation(tried, max(fair), folds, left_out)
