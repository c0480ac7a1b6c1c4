# SPDX-License-Identifier: Apache-2.0
"""Where targets and stations are: for an arm's parameters the best places, and a start for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable, forward_kinematics
from calib_model.transforms import (
    RigidTransform,
    nearest_rotation,
    rotation_matrix,
    rotation_vectors,
    skew,
)
from calib_solver.points.problem import PointProblem
from calib_solver.problem import IntArray

#: a step is small when nothing moves by more (m, rad)
SMALL = 1e-12
MOST_STEPS = 60
#: eigenvalues of the places' J'J below this part of the largest are rounding
TOLERANCE = 1e-13
#: from how far off the flange targets are sought, m: 0 and each way along its axes
START = 0.15
#: points that a start is tried on
TRIED = 400


@dataclass(frozen=True)
class Places:
    """Rotations (S, 3, 3) and translations (S, 3) of T_tracker_base of S stations, and of
    flange_T_target of K targets."""

    station_rotation: Array
    station: Array
    target_rotation: Array
    target: Array

    @classmethod
    def of(cls, problem: PointProblem) -> Places:
        """All at the origin."""
        stations, targets = len(problem.stations), len(problem.targets)
        return cls(
            np.tile(np.eye(3), (stations, 1, 1)),
            np.zeros((stations, 3)),
            np.tile(np.eye(3), (targets, 1, 1)),
            np.zeros((targets, 3)),
        )

    def moved(self, step: Array) -> Places:
        """After a step (6 K + 6 S,): each target's translation and rotation in the flange, then
        each base's in itself."""
        count = len(self.target)
        of_target = step[: 6 * count].reshape(-1, 6)
        of_station = step[6 * count :].reshape(-1, 6)
        turn = np.array([rotation_matrix(each) for each in of_target[:, 3:]]).reshape(-1, 3, 3)
        base = np.array([rotation_matrix(each) for each in of_station[:, 3:]]).reshape(-1, 3, 3)
        return Places(
            self.station_rotation @ base,
            self.station + np.einsum('sij,sj->si', self.station_rotation, of_station[:, :3]),
            turn @ self.target_rotation,
            self.target + of_target[:, :3],
        )

    def transforms(self) -> tuple[list[RigidTransform], list[RigidTransform]]:
        """T_tracker_base of every station, flange_T_target of every target."""
        return (
            _transforms(self.station_rotation, self.station),
            _transforms(self.target_rotation, self.target),
        )


def _transforms(rotation: Array, translation: Array) -> list[RigidTransform]:
    vectors = rotation_vectors(rotation)
    return [RigidTransform(*pair) for pair in zip(translation, vectors, strict=True)]


@dataclass(frozen=True)
class Flange:
    """T_base_flange of every point: `rotation` (N, 3, 3) and `origin` (N, 3), m."""

    rotation: Array
    origin: Array

    @classmethod
    def of(cls, problem: PointProblem, table: ParameterTable, full: Array) -> Flange:
        """By all columns `full` (C,) of a table."""
        arm = problem.arm.with_geometry(full[: 5 * table.n].reshape(5, table.n))
        errors = table.joint_errors(full)
        joints = problem.joints
        if errors is not None:
            joints = joints + errors.angles(arm, joints)
        T_base_flange = forward_kinematics(arm, joints)
        return cls(T_base_flange[:, :3, :3], T_base_flange[:, :3, 3])

    def points(self, problem: PointProblem, places: Places) -> Array:
        """Where the targets are in the base frame (N, 3), m."""
        return self.origin + np.einsum('nij,nj->ni', self.rotation, places.target[problem.target])

    def residuals(self, problem: PointProblem, places: Places) -> tuple[Array, Array]:
        """Predicted less measured in the base frame: positions (N, 3), m, and rotation vectors
        (N, 3), rad, zero where there is no orientation."""
        seen = problem.position - places.station[problem.station]
        turned = places.station_rotation[problem.station]
        away: Array = self.points(problem, places) - np.einsum('nji,nj->ni', turned, seen)
        turn = np.zeros_like(away)
        rows = np.flatnonzero(problem.oriented)
        if len(rows):
            predicted = self.rotation[rows] @ places.target_rotation[problem.target[rows]]
            measured = np.swapaxes(turned[rows], 1, 2) @ problem.rotation[rows]
            turn[rows] = rotation_vectors(predicted @ np.swapaxes(measured, 1, 2))
        return away, turn


def squares(problem: PointProblem, residuals: tuple[Array, Array]) -> float:
    """The weighted sum of squares, m^2."""
    away, turn = residuals
    total = problem.trust @ (problem.weight * (away**2).sum(axis=1))
    return float(total + problem.turn_weight * (problem.trust @ (turn**2).sum(axis=1)))


def columns_of(problem: PointProblem, part: int) -> IntArray:
    """The places' columns that the points of a part have: six of its target, six of its station."""
    first = int(problem.parts[part])
    target = 6 * int(problem.target[first])
    station = 6 * (len(problem.targets) + int(problem.station[first]))
    return np.concatenate([np.arange(target, target + 6), np.arange(station, station + 6)])


def motions(rotation: Array, point: Array) -> tuple[Array, Array]:
    """How residuals in position and in rotation (R, 3, 12) go with a part's target and station;
    `rotation` (R, 3, 3) is the flange's, `point` (R, 3) the target, in the base frame."""
    none, one = np.zeros_like(rotation), np.broadcast_to(np.eye(3), rotation.shape)
    return (
        np.concatenate([rotation, none, one, -skew(point)], axis=2),
        np.concatenate([none, rotation, none, one], axis=2),
    )


def best_places(problem: PointProblem, flange: Flange, start: Places) -> Places:
    """Targets and stations where the weighted squares are least, from a `start` nearby.

    Levenberg-Marquardt on these alone, the arm held; directions that no point tells stay as they
    are.
    """
    places, damping = start, 0.0
    residuals = flange.residuals(problem, places)
    cost = squares(problem, residuals)
    for _ in range(MOST_STEPS):
        normal, gradient = _sums(problem, flange, places, residuals)
        values, vectors = np.linalg.eigh(normal)
        kept = values > TOLERANCE * values.max(initial=1e-300)
        values, vectors = values[kept], vectors[:, kept]
        along = vectors.T @ gradient
        while True:
            step = -vectors @ (along / (values + damping * values.max(initial=0.0)))
            candidate = places.moved(step)
            tried = flange.residuals(problem, candidate)
            lower = squares(problem, tried)
            if lower <= cost * (1 + 1e-12) + 1e-30 or damping > 1e3:
                break
            damping = max(10 * damping, 1e-6)
        if damping > 1e3:
            return places
        places, residuals, cost = candidate, tried, min(lower, cost)
        damping = damping / 30 if damping > 1e-9 else 0.0
        if np.abs(step).max(initial=0.0) < SMALL:
            break
        # converging fast, the next step would be rounding
        if damping == 0 and np.abs(step).max(initial=0.0) < 1e-7:
            break
    return places


def _sums(
    problem: PointProblem, flange: Flange, places: Places, residuals: tuple[Array, Array]
) -> tuple[Array, Array]:
    """J'J (P, P) and J'r (P,) of the places."""
    size = problem.places
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    points = flange.points(problem, places)
    for part in range(len(problem.parts) - 1):
        rows = slice(int(problem.parts[part]), int(problem.parts[part + 1]))
        moved, turned = motions(flange.rotation[rows], points[rows])
        own = columns_of(problem, part)
        for slope, residual, weight in (
            (moved, residuals[0][rows], problem.trust[rows] * problem.weight[rows]),
            (
                turned,
                residuals[1][rows],
                problem.turn_weight * problem.trust[rows] * problem.oriented[rows],
            ),
        ):
            if not weight.any():
                continue
            flat = (np.sqrt(weight)[:, None, None] * slope).reshape(-1, slope.shape[2])
            root = (np.sqrt(weight)[:, None] * residual).reshape(-1)
            normal[np.ix_(own, own)] += flat.T @ flat
            gradient[own] += flat.T @ root
    return normal, gradient


def start_places(problem: PointProblem, table: ParameterTable, full: Array) -> Places:
    """Places to start from where nothing is known of any: the best of several ways to hold the
    first targets, on some of the points."""
    flange = Flange.of(problem, table, full)
    some = _some(problem)
    few = problem.only(some)
    seen = Flange(flange.rotation[some], flange.origin[some])
    ways = [np.zeros(3), *(START * sign * axis for axis in np.eye(3) for sign in (1, -1))]
    found = [best_places(few, seen, _laid(few, seen, way)) for way in ways]
    best = min(found, key=lambda one: squares(few, seen.residuals(few, one)))
    return best_places(problem, flange, best)


def _some(problem: PointProblem) -> np.ndarray:
    """A mask of points of every target and station, evenly spread."""
    kept = np.zeros(len(problem), dtype=np.bool_)
    share = max(TRIED // (len(problem.parts) - 1), 8)
    for first, last in zip(problem.parts[:-1], problem.parts[1:], strict=True):
        rows = np.linspace(first, last - 1, min(share, int(last - first)))
        kept[np.round(rows).astype(np.int64)] = True
    return kept


def _laid(problem: PointProblem, flange: Flange, way: Array) -> Places:
    """Every target at `way` (3,) off the flange, each station laid over what that gives."""
    places = Places.of(problem)
    target = np.tile(way, (len(problem.targets), 1))
    rotation, translation = places.station_rotation.copy(), places.station.copy()
    turns = places.target_rotation.copy()
    points = flange.points(problem, Places(rotation, translation, turns, target))
    for s in range(len(problem.stations)):
        rows = problem.station == s
        if not rows.any():
            continue
        here, there = points[rows].mean(axis=0), problem.position[rows].mean(axis=0)
        covariance = (problem.position[rows] - there).T @ (points[rows] - here)
        rotation[s] = nearest_rotation(covariance)
        translation[s] = there - rotation[s] @ here
    for k in range(len(problem.targets)):
        rows = (problem.target == k) & (problem.oriented > 0)
        if rows.any():
            measured = np.swapaxes(rotation[problem.station[rows]], 1, 2) @ problem.rotation[rows]
            each = np.swapaxes(flange.rotation[rows], 1, 2) @ measured
            turns[k] = nearest_rotation(each.sum(axis=0))
    return Places(rotation, translation, turns, target)
