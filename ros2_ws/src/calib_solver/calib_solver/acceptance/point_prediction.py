# SPDX-License-Identifier: Apache-2.0
"""What a calibration by measured points states for points that it was not told of.

To first order the errors are e = M (J dz + noise): dz the errors of parameters, targets and known
stations, M what is left of it where a station is placed by its own points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_solver.acceptance.prediction import LEVEL, Moments, Stated
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.fitting import PoseNoise
from calib_solver.points import (
    PlaceShares,
    PointProblem,
    PointQuality,
    StationShare,
    moved_by_joints,
    point_slopes,
)
from calib_solver.problem import IntArray


def stated_points(
    result: StoredResult, shares: PlaceShares, problem: PointProblem, quality: PointQuality
) -> Stated:
    """Of the positions of all points; `quality` is that of the result's arm, targets and stations
    on the problem's points."""
    full = result.full.copy()
    full[result.table.mount] = 0.0  # the flange: targets are beside the table
    rows, places = np.arange(len(problem)), quality.places
    slope, _ = point_slopes(problem, result.table, full, places, rows)
    moved, _ = moved_by_joints(problem, result.table, full, places, rows)
    scatter = _scatter(result.stated.shares.poses, shares, problem, moved)
    common = _of_each_point(result, shares, problem, slope)
    left: Array = np.zeros_like(common)
    mean = variance = 0.0
    known = {one.number for one in shares.stations}
    for s, number in enumerate(problem.stations):
        own = np.flatnonzero(problem.station == s)
        placing: Array = slope[own][:, :, -6:]
        station = _Placed.of(
            placing[:, :, :0] if number in known else placing, problem.weight[own], scatter[own]
        )
        left[own] = station.left(common[own])
        mean += station.mean
        variance += 2 * station.square + 4 * station.crossed(left[own])
    flat = left.reshape(-1, left.shape[2])
    gram = flat.T @ flat
    moments = Moments(mean + float(np.trace(gram)), variance + 2 * float((gram**2).sum()))
    return moments.stated(quality.distance, LEVEL, result.stated.shares.poses.freedom)


def _scatter(noise: PoseNoise, shares: PlaceShares, problem: PointProblem, moved: Array) -> Array:
    """Covariance (N, 3, 3), m^2, of the points by their own noise; they move with the joints'
    readings by `moved` (N, 3, n)."""
    of_part = [
        shares.times(problem.targets[problem.target[row]], problem.stations[problem.station[row]])
        for row in problem.parts[:-1]
    ]
    times = np.array(of_part)[problem.part] / problem.weight
    alike = times[:, None, None] * np.eye(3) - np.eye(3)
    scatter: Array = noise.covariance(moved) + noise.point * alike
    return scatter


@dataclass(frozen=True)
class _Placed:
    """Points of one station: with M = 1 - P A what is left of their errors once it is placed by
    them, and S their `scatter` (N, 3, 3), M S M' = S - P Z' - Z P'; `motion` P (3N, 6) is empty
    where it is known from before."""

    scatter: Array
    motion: Array
    taking: Array
    z: Array

    @classmethod
    def of(cls, placing: Array, weight: Array, scatter: Array) -> _Placed:
        """Of points that move with their station by `placing` (N, 3, 6), or (N, 3, 0)."""
        motion: Array = placing.reshape(3 * len(placing), -1)
        weighed = np.repeat(weight, 3)[:, None] * motion
        taking = np.linalg.pinv(motion.T @ weighed, hermitian=True) @ weighed.T
        spread = _times(scatter, taking.T)
        return cls(scatter, motion, taking, spread - 0.5 * motion @ (taking @ spread))

    def left(self, columns: Array) -> Array:
        """What is left (N, 3, R) of errors."""
        flat = columns.reshape(len(self.motion), -1)
        return (flat - self.motion @ (self.taking @ flat)).reshape(columns.shape)

    @property
    def mean(self) -> float:
        """tr M S M'."""
        whole = np.trace(self.scatter, axis1=1, axis2=2).sum()
        return float(whole - 2 * (self.motion * self.z).sum())

    @property
    def square(self) -> float:
        """tr (M S M')^2."""
        motion, z = self.motion, self.z
        across = motion.T @ z
        gram = np.trace((motion.T @ motion) @ (z.T @ z)) + np.trace(across @ across)
        once = (_times(self.scatter, motion) * z).sum()
        return float((self.scatter**2).sum() - 4 * once + 2 * gram)

    def crossed(self, left: Array) -> float:
        """The sum of c' M S M' c over columns c that are `left` (N, 3, R)."""
        flat = left.reshape(len(self.motion), -1)
        whole = (flat * _times(self.scatter, flat)).sum()
        return float(whole - 2 * ((self.motion.T @ flat) * (self.z.T @ flat)).sum())


def _times(blocks: Array, columns: Array) -> Array:
    """Blocks (N, 3, 3) times columns (3N, R)."""
    product: Array = blocks @ columns.reshape(len(blocks), 3, -1)
    return product.reshape(columns.shape)


def _of_each_point(
    result: StoredResult, shares: PlaceShares, problem: PointProblem, slope: Array
) -> Array:
    """Columns (N, 3, R) whose squares add up to the covariance of the points' errors, but for the
    points' own noise."""
    stations = {one.number: one for one in shares.stations}
    seen = [stations[number] for number in problem.stations if number in stations]
    free = len(result.stated.names)
    moved = _by_columns(slope, free, problem.target, len(shares.targets))
    own = np.zeros((len(problem), 3, 6 * len(seen)))
    for place, one in enumerate(seen):
        rows = np.flatnonzero(problem.station == problem.stations.index(one.number))
        placing = slope[rows][:, :, -6:]
        moved[rows] += placing @ one.along
        own[rows, :, 6 * place : 6 * place + 6] = placing
    by_noise = np.concatenate([moved, own], axis=2) @ _root(_together(shares, seen))
    return np.concatenate([by_noise, moved @ (shares.prior * result.stated.shares.width)], axis=2)


def _together(shares: PlaceShares, seen: list[StationShare]) -> Array:
    """The covariance (G + 6 S, G + 6 S), by what single points are off, of parameters and targets
    and of the own part of the stations `seen`."""
    size = len(shares.noise)
    covariance = np.zeros((size + 6 * len(seen),) * 2)
    covariance[:size, :size] = shares.noise
    for place, one in enumerate(seen):
        at = slice(size + 6 * place, size + 6 * place + 6)
        covariance[at, at] = one.own
        covariance[:size, at], covariance[at, :size] = one.common, one.common.T
    return covariance


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
