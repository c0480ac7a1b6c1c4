# SPDX-License-Identifier: Apache-2.0
"""A calibration judges itself: what it says of places that it was not told, and what is so there.

Each gauge location is left out in turn, of a single location each region of postures. The fit
without it is linear about the one with it, so that sums per sphere tell all of them at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Gauge
from calib_solver.fitting import (
    Fit,
    Solver,
    Uncertainty,
    apart,
    certified_root,
    distance_errors,
    estimate_uncertainty,
    fit_placement,
    linear_step,
)
from calib_solver.problem import (
    Folds,
    IntArray,
    Problem,
    SphereSums,
    merged_sums,
    take_groups,
)

#: regions of postures that a single location is cut into, none with fewer poses than this
REGIONS, FEWEST_POSES = 5, 4
#: what is seen counts as more than is stated where chance does it as seldom as it takes a normal
#: variable beyond so many standard deviations: once in 740 times
SIGNIFICANT = 3.0


@dataclass(frozen=True)
class Prediction:
    """The rms error (m) of `count` predictions, the rms that was `stated` for them."""

    rms: float
    stated: float
    count: int


@dataclass(frozen=True)
class LeftOut:
    """What was left out in turn, `by` 'location' or 'posture', in so many `folds`.

    `position` is each pose's distance from the certificate's best placement on what was left out,
    `distance` that of lengths between its spheres. `factor` (1 or more) is by how much the stated
    uncertainty of the parameters has to grow to explain these errors.
    """

    by: str
    folds: int
    position: Prediction
    distance: Prediction | None
    factor: float


@dataclass(frozen=True)
class _Fold:
    """A problem and its sums without one part, the rows of `finer` sums that are this part, and
    the rows of the distances left out with it."""

    problem: Problem
    sums: SphereSums
    rows: IntArray
    pairs: IntArray


@dataclass(frozen=True)
class FoldError:
    """Of one fold, m^2: the sum of squares that is seen, that the noise and the certificate
    explain, and that the parameters' uncertainty does; `spread` is the sum of squares of the
    eigenvalues of what is stated, which says how far chance takes it."""

    seen: float
    noise: float
    parameters: float
    count: int
    spread: float = 0.0


def judge_left_out(
    of_locations: Folds, solver: Solver, fit: Fit, sums: SphereSums
) -> LeftOut | None:
    """Every part of a problem as the rest of it predicts it; None where it has no parts.

    `of_locations` are the problem's folds, taken where it has several; `fit` is the solver's
    minimum and `sums` those there.
    """
    problem = of_locations.problem
    if len(fit.x) == 0:
        return None
    by = 'location' if len(problem.locations) > 1 else 'posture'
    finer, of_finer, folds = (
        (problem, sums, _locations(of_locations, sums))
        if by == 'location'
        else _postures(problem, solver, fit)
    )
    if len(folds) < 2:
        return None
    placed, between = _Placed.at(finer, of_finer), distance_errors(problem, sums)
    prior, wider = fit.kappa * solver.information, solver.wider(fit)
    root = certified_root(problem)
    positions, distances, covariances = [], [], []
    for fold in folds:
        quadratic = solver.objective(fold.problem, fold.sums)
        if quadratic.terms < 1:
            return None
        step = linear_step(quadratic.normal, quadratic.gradient, prior, fit.x)
        sure = estimate_uncertainty(
            fold.problem,
            solver.options.objective,
            fold.sums,
            quadratic,
            fit.kappa,
            solver.information,
            solver.options.prior.strength,
            wider,
        )
        positions.append(placed.errors(of_finer, fold.rows, step, sure))
        if len(fold.pairs):
            own = root[fold.pairs]
            distances.append(
                _distances(problem, sums, between, fold.pairs, step, sure, own @ own.T)
            )
            covariances.append(sure.covariance)
    if distances:
        pairs = [fold.pairs for fold in folds if len(fold.pairs)]
        distances.append(_in_common(root, between[1], np.mean(covariances, axis=0), pairs))
    return LeftOut(
        by,
        len(folds),
        prediction(positions),
        prediction(distances) if distances else None,
        max(growth(positions, 0.0), growth(distances, 1.0)),
    )


def missed(left_out: LeftOut, part: str) -> str:
    """By how much the parts left out were missed, beside what was stated: that of positions and
    lengths which was stated the worst."""
    found, where = left_out.position, f'{part} left out are'
    lengths = left_out.distance
    if lengths is not None and lengths.rms * found.stated > found.rms * lengths.stated:
        found, where = lengths, f'lengths at {part} left out are'
    return (
        f'{where} missed by {found.rms * 1e3:.4f} mm where '
        f'{found.stated * 1e3:.4f} mm was stated (rms)'
    )


def left_out_warnings(left_out: LeftOut | None, named: bool) -> tuple[str, ...]:
    """A line where what was left out was missed by more than was stated, and nothing was `named`
    that it may come from."""
    if left_out is None or left_out.factor == 1 or named:
        return ()
    part = 'locations' if left_out.by == 'location' else 'postures'
    return (
        f'{missed(left_out, part)}: something is wrong that is not named here, or the arm has '
        'errors beyond its parameters (joints that bend, encoders, backlash); '
        f'stated uncertainties are enlarged {left_out.factor:.2g} times for it, which may not '
        'cover postures far from those probed',
    )


def _locations(of_locations: Folds, sums: SphereSums) -> list[_Fold]:
    """Each gauge location left out, or several at a time."""
    folds, pairs = [], of_locations.problem.pairs
    for rows, kept in zip(of_locations.rows, of_locations.without(sums), strict=True):
        own = np.flatnonzero(np.isin(pairs, rows).any(axis=1))
        folds.append(_Fold(*kept, rows, own))
    return folds


def _postures(
    problem: Problem, solver: Solver, fit: Fit
) -> tuple[Problem, SphereSums, list[_Fold]]:
    """Each region of postures left out: poses next to one another along the direction in which the
    joints vary most. The finer problem has each sphere once in every region."""
    away = problem.joints - problem.joints.mean(axis=0)
    along = away @ np.linalg.svd(away, full_matrices=False)[2][0]
    count = min(REGIONS, len(along) // FEWEST_POSES)
    if count < 2:
        return problem, solver.sums(problem, fit.x), []
    region = np.argsort(np.argsort(along)) * count // len(along) + 1
    poses = problem.measured.poses
    location = np.empty(len(region), dtype=np.int64)
    location[problem.order] = region
    measured = replace(problem.measured, poses=replace(poses, location=location))
    finer = replace(Problem.of(measured), pairs=np.zeros((0, 2), dtype=np.int64))
    finer = replace(finer, nominal=np.zeros(0), pair_weight=np.zeros(0))
    # the gauge stood where it stood: one placement for what was cut into regions
    stood = {
        int(key[1]): int(one) for key, one in zip(problem.keys, problem.placement, strict=True)
    }
    finer = replace(finer, placement=np.array([stood[int(key[1])] for key in finer.keys]))
    sums = solver.sums(finer, fit.x)
    folds = []
    for one in range(1, count + 1):
        kept = np.flatnonzero(finer.keys[:, 0] != one)
        spheres = [np.flatnonzero(finer.keys[kept, 1] == key[1]) for key in problem.keys]
        present = np.flatnonzero([len(rows) > 0 for rows in spheres])
        part = take_groups(problem, [present])
        merged = merged_sums(sums, [kept[spheres[row]] for row in present])
        rows = np.flatnonzero(finer.keys[:, 0] == one)
        folds.append(_Fold(part, merged, rows, np.zeros(0, dtype=np.int64)))
    return finer, sums, folds


@dataclass(frozen=True)
class _Placed:
    """The means' residuals (3S,) to the certificate as placed, times the root of their counts, and
    their `slope` (3S, F)."""

    residual: Array
    slope: Array
    certified: Array

    @classmethod
    def at(cls, problem: Problem, sums: SphereSums) -> _Placed:
        spheres, free = sums.gradient.shape
        residual, slope = np.zeros((spheres, 3)), np.zeros((spheres, 3, free))
        certified = np.zeros(spheres)
        for rows in problem.placements:
            fitted = fit_placement(problem, sums, rows)
            residual[rows] = fitted.residual.reshape(-1, 3)
            slope[rows] = fitted.slope.reshape(len(rows), 3, free)
            certified[rows] = _of_centers(problem.measured.gauge, problem.keys[rows, 1])
        return cls(residual, slope, certified)

    def errors(self, sums: SphereSums, rows: IntArray, step: Array, sure: Uncertainty) -> FoldError:
        """Of the poses of some spheres, after a step (F,) that is so sure."""
        free, noise = len(step), sure.noise**2
        slope = self.slope[rows].reshape(-1, free)
        moved = self.residual[rows].reshape(-1) + slope @ step
        normal = sums.normal[rows].sum(axis=0)
        bent = step @ normal @ step + 2 * sums.gradient[rows].sum(axis=0) @ step
        seen = max(float(sums.spread[rows].sum() + bent), 0.0) + float(moved @ moved)
        stated = sure.covariance @ (normal + slope.T @ slope)
        count = float(sums.count[rows].sum())
        by_noise = noise * 3 * count + float(sums.count[rows] @ self.certified[rows])
        by_parameters = float(np.trace(stated))
        spread = float(np.sum(stated * stated.T)) + 2 * noise * by_parameters
        return FoldError(seen, by_noise, by_parameters, round(count), spread + 3 * count * noise**2)


def _of_centers(gauge: Gauge, numbers: IntArray) -> Array:
    """The variance (k,) of the distance of each centre from its place, m^2, by the certificate."""
    centers = np.array([gauge.center(int(number)) for number in numbers])
    away = ((centers - centers.mean(axis=0)) ** 2).sum(axis=1)
    variance: Array = 3 * (gauge.constant / 2) ** 2 / 2 + (gauge.proportional / 2) ** 2 * away
    return variance


def _distances(
    problem: Problem,
    sums: SphereSums,
    between: tuple[Array, Array],
    rows: IntArray,
    step: Array,
    sure: Uncertainty,
    certified: Array,
) -> FoldError:
    """Of some of the distances (m,), whose errors and slopes are `between`, after a step (F,) that
    is so sure; `certified` (m, m) is what the certificate leaves open of them, m^2."""
    slope = between[1][rows]
    error = between[0][rows] + slope @ step
    means = _by_means(problem, sums, rows)
    by_noise = sure.noise**2 * means @ means.T + certified
    by_parameters = slope @ sure.covariance @ slope.T
    return FoldError(
        float(error @ error),
        float(np.trace(by_noise)),
        float(np.trace(by_parameters)),
        len(rows),
        float(((by_noise + by_parameters) ** 2).sum()),
    )


def _in_common(root: Array, slope: Array, covariance: Array, parts: list[IntArray]) -> FoldError:
    """What folds have in common adds to what chance may do, to no mean: the gauge is off by the
    same at every location, and most of what tells the parameters is the same without any one.

    `root` is that of what the certificate leaves open; of B B' the squares sum up as of B' B, which
    does not grow with the distances.
    """
    values, vectors = np.linalg.eigh(covariance)
    both = np.hstack([root, slope @ (vectors * np.sqrt(np.maximum(values, 0.0)))])
    squares = [float(((each.T @ each) ** 2).sum()) for each in (both, *(both[p] for p in parts))]
    return FoldError(0.0, 0.0, 0.0, 0, max(squares[0] - math.fsum(squares[1:]), 0.0))


def _by_means(problem: Problem, sums: SphereSums, rows: IntArray) -> Array:
    """How some distances go with the noise of their spheres' means (m, 3 k), those coordinates of
    variance 1 per pose."""
    pairs = problem.pairs[rows]
    spheres, place = np.unique(pairs, return_inverse=True)
    place = place.reshape(-1, 2)
    _, unit = apart(sums.center, pairs)
    means = np.zeros((len(rows), len(spheres), 3))
    each = np.arange(len(rows))
    means[each, place[:, 0]], means[each, place[:, 1]] = unit, -unit
    means /= np.sqrt(np.maximum(sums.count[spheres], 1e-300))[:, None]
    return means.reshape(len(rows), -1)


def _totals(errors: list[FoldError]) -> Iterator[float]:
    for field in fields(FoldError):
        # exact: what `sum` makes of it depends on Python's version
        yield math.fsum(getattr(one, field.name) for one in errors)


def prediction(errors: list[FoldError]) -> Prediction:
    seen, noise, parameters, count, _ = _totals(errors)
    count = max(count, 1.0)
    stated = float(np.sqrt((noise + parameters) / count))
    return Prediction(float(np.sqrt(seen / count)), stated, int(count))


def growth(errors: list[FoldError], explained: float) -> float:
    """By how much the parameters' stated deviations fall short of the errors seen, 1 or more.

    Of the noise the part `explained` is taken for such. Where places scatter more than noise and
    parameters explain, the scatter of poses is no noise either, but what the model does not say.
    """
    seen, noise, parameters, _, spread = _totals(errors)
    if parameters <= 0 or seen <= _by_chance(noise + parameters, spread):
        return 1.0
    return float(np.sqrt((seen - explained * noise) / parameters))


def _by_chance(mean: float, spread: float) -> float:
    """How large a sum of squares of that mean gets by chance: that of chi-square with as many
    degrees of freedom as give its variance, 2 `spread` (Satterthwaite; Wilson and Hilferty)."""
    of_root = 2.0 * spread / (9.0 * mean**2)
    return float(mean * (1.0 - of_root + SIGNIFICANT * np.sqrt(of_root)) ** 3)
