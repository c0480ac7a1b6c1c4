# SPDX-License-Identifier: Apache-2.0
"""What a calibration by measured points states for points that it was not told of.

To first order the errors are e = M (J dz + noise): dz the errors of parameters, targets and known
stations, M what is left of it where a station is placed by its own points.
"""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_solver.acceptance.prediction import LEVEL, Moments, Stated
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.points import PlaceShares, PointProblem, PointQuality, point_slopes
from calib_solver.problem import IntArray


def stated_points(
    result: StoredResult, shares: PlaceShares, problem: PointProblem, quality: PointQuality
) -> Stated:
    """Of the positions of all points; `quality` is that of the result's arm, targets and stations
    on the problem's points."""
    full = result.full.copy()
    full[result.table.mount] = 0.0  # the flange: targets are beside the table
    rows = np.arange(len(problem))
    slope, _ = point_slopes(problem, result.table, full, quality.places, rows)
    variance = result.stated.shares.poses.point / problem.weight
    common = _of_each_point(result, shares, problem, slope)
    left: Array = np.zeros_like(common)
    noise_mean = noise_square = crossed = 0.0
    known = {one.number for one in shares.stations}
    for s, number in enumerate(problem.stations):
        own = np.flatnonzero(problem.station == s)
        columns: Array = common[own].reshape(3 * len(own), -1)
        covariance = np.repeat(variance[own], 3)
        placing: Array = slope[own][:, :, -6:].reshape(3 * len(own), 6)
        if number in known:
            placing = placing[:, :0]
        weight = np.repeat(problem.weight[own], 3)[:, None] * placing
        inverse = np.linalg.pinv(placing.T @ weight, hermitian=True)
        columns = columns - placing @ (inverse @ (weight.T @ columns))
        taken = result.stated.shares.poses.point * inverse  # of the noise, by the placement
        gram = placing.T @ placing
        noise_mean += float(covariance.sum() - np.trace(taken @ gram))
        twice = placing.T @ (covariance[:, None] * placing)
        noise_square += float(
            (covariance**2).sum()
            - 2 * np.trace(taken @ twice)
            + np.trace(taken @ gram @ taken @ gram)
        )
        along = placing.T @ columns
        crossed += float((covariance[:, None] * columns**2).sum() - (along * (taken @ along)).sum())
        left[own] = columns.reshape(len(own), 3, -1)
    flat = left.reshape(-1, left.shape[2])
    gram = flat.T @ flat
    moments = Moments(
        noise_mean + float(np.trace(gram)),
        2 * noise_square + 4 * crossed + 2 * float((gram**2).sum()),
    )
    return moments.stated(quality.distance, LEVEL, result.stated.shares.poses.freedom)


def _of_each_point(
    result: StoredResult, shares: PlaceShares, problem: PointProblem, slope: Array
) -> Array:
    """Columns (N, 3, R) whose squares add up to the covariance of the points' errors, but for the
    points' own noise."""
    root = np.concatenate([_root(shares.noise), shares.prior * result.stated.shares.width], axis=1)
    stations = {one.number: one for one in shares.stations}
    free = len(result.stated.names)
    moved = _by_columns(slope, free, problem.target, len(shares.targets))
    own = np.zeros((len(problem), 3, 6 * len(problem.stations)))
    for s, number in enumerate(problem.stations):
        if number in stations:
            rows, one = np.flatnonzero(problem.station == s), stations[number]
            placing = slope[rows][:, :, -6:]
            moved[rows] += placing @ one.along
            own[rows, :, 6 * s : 6 * s + 6] = placing @ _root(one.own)
    return np.concatenate([moved @ root, own], axis=2)


def _by_columns(slope: Array, free: int, target: IntArray, targets: int) -> Array:
    """How points go with free parameters and every target (N, 3, F + 6 K), from their slopes by
    their own target."""
    moved = np.zeros((len(slope), 3, free + 6 * targets))
    moved[:, :, :free] = slope[:, :, :free]
    for k in range(targets):
        rows = np.flatnonzero(target == k)
        moved[rows, :, free + 6 * k : free + 6 * k + 6] = slope[rows, :, free : free + 6]
    return moved


def _root(covariance: Array) -> Array:
    values, axes = np.linalg.eigh(covariance)
    root: Array = axes * np.sqrt(np.maximum(values, 0.0))
    return root
