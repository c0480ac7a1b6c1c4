# SPDX-License-Identifier: Apache-2.0
"""What a calibration states for poses that it was not told of, and whether they keep to it.

To first order the poses' errors are e = (1 - Pi)(J dx - A c + noise): the parameters' errors dx,
the certificate's c and the noise of the poses, less what the gauge's best placement, Pi, takes up.
Where the calibration was made with the same gauge, its certificate's error is in dx, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri, fdtri

from calib_model.arrays import Array
from calib_solver.acceptance.certificate import certificate_roots, same_certificate, together
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.fitting import positions_moved
from calib_solver.problem import Placed, Problem, place_gauge, point_jacobian
from calib_solver.quality import Quality

#: how often poses are said to miss what is stated where all is as stated
LEVEL = 0.05
#: motions of the gauge below this part of the largest are seen by no sphere
SEEN = 1e-9


@dataclass(frozen=True)
class Stated:
    """The rms error (m) of `count` values, what was `stated` for it, and the `bound` that it keeps
    to in 95 of 100 cases."""

    rms: float
    stated: float
    bound: float
    count: int

    @property
    def within(self) -> bool:
        """Whether the error is what was stated."""
        return self.rms <= self.bound


@dataclass(frozen=True)
class Moments:
    """Mean and variance of a sum of squares, m^2 and m^4."""

    mean: float
    variance: float

    def stated(self, values: Array, level: float, known_by: int = 0) -> Stated:
        """By Satterthwaite's chi-square with these moments; by an F where these scale with a noise
        that is `known_by` so many residuals."""
        count = len(values)
        rms = float(np.sqrt(np.mean(values**2)))
        if self.mean <= 0 or self.variance <= 0:
            return Stated(rms, 0.0, 0.0, count)
        freedom = 2 * self.mean**2 / self.variance
        bound = float(chdtri(freedom, level)) / freedom
        if known_by:
            bound = float(fdtri(freedom, known_by, 1 - level))
        bound *= self.mean
        return Stated(rms, float(np.sqrt(self.mean / count)), float(np.sqrt(bound / count)), count)


def stated_errors(
    result: StoredResult, problem: Problem, quality: Quality
) -> tuple[Stated, Stated | None]:
    """Of the positions of all poses, and of the distances, where there are any.

    `quality` is that of the result's arm and probe on the problem's poses.
    """
    level = LEVEL / (2 if len(problem.pairs) else 1)
    errors = _Errors.of(result, problem, quality)
    position = _positions(errors).stated(quality.position, level)
    if not len(problem.pairs):
        return position, None
    return position, _distances(errors).stated(quality.distance, level)


@dataclass(frozen=True)
class _Errors:
    """What the poses' points move with: the free parameters, by `slope` (N, 3, F), their own noise
    of covariance `scatter` (N, 3, 3), m^2, and the gauge, which is `placed` at each placement, by
    the coordinates of its spheres, `turned` (S, 3, 3K)."""

    result: StoredResult
    problem: Problem
    centers: Array
    slope: Array
    scatter: Array
    placed: tuple[Placed, ...]
    turned: Array

    @classmethod
    def of(cls, result: StoredResult, problem: Problem, quality: Quality) -> _Errors:
        """Of the poses of a problem, whose spheres a `quality` has the centres of."""
        rows = np.arange(len(problem.joints))
        _, jacobian = point_jacobian(problem, result.table, result.full, rows)
        moved = positions_moved(problem, result.table, jacobian)
        centers, gauge = quality.spheres.center, problem.measured.gauge
        certified = np.array([gauge.center(int(number)) for number in problem.keys[:, 1]])
        placed = tuple(
            place_gauge(certified[rows], centers[rows], problem.counts[rows].astype(float))
            for rows in problem.placements
        )
        return cls(
            result,
            problem,
            centers,
            jacobian[:, :, result.table.free_columns],
            result.stated.shares.poses.covariance(moved),
            placed,
            _certified_slopes(problem, placed),
        )


def _certified_slopes(problem: Problem, placements: Sequence[Placed]) -> Array:
    """How each sphere's certified place moves with the gauge's coordinates, (S, 3, 3K)."""
    gauge = problem.measured.gauge
    found = np.zeros((len(problem.keys), 3, 3 * len(gauge.spheres)))
    for rows, placed in zip(problem.placements, placements, strict=True):
        for row in rows:
            at = 3 * gauge.numbers.index(int(problem.keys[row, 1]))
            found[row, :, at : at + 3] = placed.rotation
    return found


def _roots(result: StoredResult, problem: Problem, slope: Array, by_center: Array) -> Array:
    """Columns (R, k) that parameters and certificate make of errors that go with the parameters
    by `slope` (R, F), with this gauge's coordinates by `by_center` (R, 3K)."""
    shares, gauge = result.stated.shares, problem.measured.gauge
    values, axes = np.linalg.eigh(shares.noise)
    by_noise = slope @ (axes * np.sqrt(np.maximum(values, 0.0)))
    by_gauge = together(
        certificate_roots(slope @ shares.certificate, result.stated.gauge),
        certificate_roots(by_center, gauge),
        same_certificate(result.stated.gauge, gauge),
    )
    return np.concatenate([by_noise, slope @ (shares.prior * shares.width), by_gauge], axis=1)


def _positions(errors: _Errors) -> Moments:
    """Of the sum of squares of all poses' distances to the certificate as placed."""
    problem, slope, turned = errors.problem, errors.slope, errors.turned
    of_pose = np.repeat(np.arange(len(problem.counts)), problem.counts)
    columns = _roots(
        errors.result,
        problem,
        slope.reshape(-1, slope.shape[2]),
        -turned[of_pose].reshape(-1, turned.shape[2]),
    ).reshape(len(of_pose), 3, -1)
    mean = variance = 0.0
    left = np.zeros_like(columns)
    for rows, placed in zip(problem.placements, errors.placed, strict=True):
        own = np.isin(of_pose, rows)
        motion = placed.motion[np.searchsorted(rows, of_pose[own])].reshape(-1, 6)
        basis, size, _ = np.linalg.svd(motion, full_matrices=False)
        basis = basis[:, size > SEEN * size[0]]
        flat = columns[own].reshape(len(motion), -1)
        left[own] = (flat - basis @ (basis.T @ flat)).reshape(columns[own].shape)
        # noise of the poses of one placement, less what the placement takes up
        noise = errors.scatter[own]
        by_axis = basis.reshape(-1, 3, basis.shape[1])
        once = np.einsum('nka,nkl,nlb->ab', by_axis, noise, by_axis)
        twice = np.einsum('nka,nkl,nlm,nmb->ab', by_axis, noise, noise, by_axis, optimize=True)
        mean += float(np.trace(noise, axis1=1, axis2=2).sum() - np.trace(once))
        variance += 2 * float((noise**2).sum() - 2 * np.trace(twice) + (once**2).sum())
        seen = left[own]
        variance += 4 * float(np.einsum('nkr,nkl,nlr->', seen, noise, seen, optimize=True))
    flat = left.reshape(-1, left.shape[2])
    gram = flat.T @ flat
    return Moments(mean + float(np.trace(gram)), variance + 2 * float((gram**2).sum()))


def _distances(errors: _Errors) -> Moments:
    """Of the sum of squares of the distances' errors."""
    problem, turned = errors.problem, errors.turned
    first, second = problem.pairs.T
    between = errors.centers[first] - errors.centers[second]
    unit = between / np.maximum(np.linalg.norm(between, axis=1), 1e-300)[:, None]
    starts, count = problem.start[:-1], problem.counts
    mean_slope = np.add.reduceat(errors.slope, starts, axis=0) / count[:, None, None]
    mean_noise = np.add.reduceat(errors.scatter, starts, axis=0) / count[:, None, None] ** 2
    by_parameters = np.einsum('mk,mkf->mf', unit, mean_slope[first] - mean_slope[second])
    by_center = -np.einsum('mk,mkc->mc', unit, turned[first] - turned[second])
    columns = _roots(errors.result, problem, by_parameters, by_center)
    covariance = columns @ columns.T
    to_means = np.zeros((len(unit), len(count), 3))
    rows = np.arange(len(unit))
    to_means[rows, first] = unit
    to_means[rows, second] = -unit
    covariance += np.einsum('msk,skl,nsl->mn', to_means, mean_noise, to_means, optimize=True)
    return Moments(float(np.trace(covariance)), 2 * float((covariance**2).sum()))
