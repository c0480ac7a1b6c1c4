# SPDX-License-Identifier: Apache-2.0
"""Readings that do not belong: slipped contacts, wrong sphere numbers, a gauge that moved.

Poses are judged by their distance from their sphere's centre against the median of all such
distances, spheres by their certified distances; the fit is repeated with less weight on what
stands out, until what is left out no longer changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array, lengths, median, read_only
from calib_solver.faults.stuck_styli import Stretch, set_apart
from calib_solver.fitting import Descent, Solver
from calib_solver.problem import IntArray, Problem
from calib_solver.quality import Quality, probed_points

#: a pose this many times further out than the median does not belong; normal noise along a single
#: direction, the most straggling kind, gets there once in ten million poses
FAR = 8.0
#: poses with a stylus that stands still do not belong if they are so many times further out
AWAY = 2.5
#: beyond this many, a pose's weight falls off while the fit is still finding its place
SOFT = 4.0
#: a sphere's poses may scatter this many times as much as those of all spheres do
UNEVEN = 4.0
#: so are distance errors against their median, which rests on far fewer
FAR_DISTANCE = 16.0
#: nothing nearer than this (m) is called a gross error, however good the rest
LEAST_SIZE = 1e-6
#: why a pose is left out when nothing better is known of it
SLIPPED = 'away from the other poses of its sphere: slipped or misread'
ROUNDS = 10
SOFT_ROUNDS = 5
#: with fewer distances their median says nothing
FEWEST_DISTANCES = 6

Moved = dict[tuple[int, int], int]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Rejected:
    """A pose left out: its `pose` number in the measurement, from 1, how far off it was (m)."""

    pose: int
    location: int
    sphere: int
    size: float
    reason: str


@dataclass(frozen=True)
class Cleaned:
    """The problem without what does not belong, what was left out, spheres that `moved`, and how
    far the fits that judged the poses have come."""

    problem: Problem
    rejected: tuple[Rejected, ...]
    moved: Moved
    warnings: tuple[str, ...]
    descent: Descent


def without_gross_errors(
    problem: Problem,
    initial: Quality,
    stretches: tuple[Stretch, ...],
    solver: Solver,
    descent: Descent,
) -> Cleaned:
    """Leave out gross errors, judged by the nominal parameters' `initial` quality and by the fits
    of a solver from `descent` on; `stretches` are those in which a stylus stands still.

    A measurement in which nothing stands out comes back as it is after one solution.
    """
    stretch = set_apart(problem, stretches)
    kept: Mask = stretch == 0
    moved = _moved_spheres(problem, *_judged_distances(problem, initial.points, kept))
    current = _weighted(problem, moved, kept.astype(float))
    bent = not kept.all() or bool(moved)
    for round_number in range(ROUNDS):
        _, descent = solver.solve(current, descent)
        arm, probe = solver.arm_and_probe(current, descent)
        points = probed_points(problem, arm, probe)
        there = points if not moved else probed_points(current, arm, probe)
        centers = _centers(problem, points, kept)
        away, usual = _deviations(problem, points, centers, stretch == 0)
        now_kept = _without_stuck(away / np.maximum(usual, LEAST_SIZE / FAR), stretch)
        alike = np.array_equal(now_kept, kept)
        known = (centers, usual) if alike and not stretch.any() else None
        error, allowed = _judged_distances(problem, points, now_kept, known)
        now_moved = _moved_spheres(problem, error, allowed)
        settled = alike and now_moved == moved
        if moved:
            error, allowed = _judged_distances(current, there, now_kept)
        kept, moved = now_kept, now_moved
        bent = bent or not kept.all() or bool((error > allowed).any())
        # at first by weight, so that nothing is lost to a fit that the bad ones have bent
        soft = bent and round_number < SOFT_ROUNDS
        if settled and not soft:
            break
        weight = kept.astype(float)
        if soft:
            weight *= _soft(away, usual)
        current = _weighted(problem, moved, weight)
        if soft:
            there = points if not moved else probed_points(current, arm, probe)
            error, allowed = _judged_distances(current, there, kept)
            softened = _soft(error, np.maximum(median(error), allowed / FAR))
            current = replace(current, pair_weight=read_only(softened))
    stuck = _stuck_lines(stretches, stretch, kept)
    if kept.all() and not moved:
        return Cleaned(problem, (), {}, stuck, descent)
    rejected = _left_out(problem, points, kept, away, stretch)
    measured = problem.measured
    remaining = measured.poses.take(np.sort(problem.order[kept]))
    cleaned = Problem.of(replace(measured, poses=remaining), moved)
    lines = stuck + _warnings(rejected, moved, len(problem.joints))
    return Cleaned(cleaned, rejected, moved, lines, descent)


def _soft(size: Array, usual: Array) -> Array:
    """Weights that fall off beyond SOFT times what is usual."""
    weight: Array = 1 / (1 + (size / np.maximum(SOFT * usual, LEAST_SIZE)) ** 2) ** 2
    return weight


def _without_stuck(times: Array, stretch: IntArray) -> Mask:
    """Which poses belong that are so many `times` (N,) further away than is usual: a stretch goes
    whole where it is away as a whole, and stays whole where it is not."""
    judged = times <= FAR
    for number in range(1, int(stretch.max(initial=0)) + 1):
        own = stretch == number
        if median(times[own]) > AWAY or judged[own].mean() < 0.5:
            judged[own] = False
    return judged


def _stuck_lines(stretches: tuple[Stretch, ...], stretch: IntArray, kept: Mask) -> tuple[str, ...]:
    """A line for each stretch that is left out, and for each that could not be judged."""
    lines = []
    for number, one in enumerate(stretches, start=1):
        own = stretch == number
        if not own.any():
            lines.append(one.line(len(kept)))
        elif not kept[own].any():
            lines.append(f'{one.line(len(kept))}; they are left out')
    return tuple(lines)


def _weighted(problem: Problem, moved: Moved, weight: Array) -> Problem:
    """The problem with spheres that `moved` apart and weights (N,) of the poses."""
    if not moved and np.array_equal(weight, problem.weight):
        return problem
    placed = Problem.of(problem.measured, moved) if moved else problem
    return replace(placed, weight=read_only(weight))


def _centers(problem: Problem, points: Array, kept: Mask) -> Array:
    """The median point of each sphere (S, 3), of its kept poses where there are any."""
    centers = np.empty((len(problem.keys), 3))
    every = bool(kept.all())
    for s in range(len(problem.keys)):
        rows = problem.rows(s)
        own = points[rows] if every else points[rows][kept[rows]]
        centers[s] = median(own if len(own) else points[rows])
    return centers


def _deviations(
    problem: Problem, points: Array, centers: Array, judging: Mask
) -> tuple[Array, Array]:
    """The distance of each pose's point (N, 3) from its sphere's centre (S, 3) and what is usual
    there, both (N,), m.

    Usual is the median of the `judging` poses, of all or of the sphere's own where that is larger,
    within reason: postures differ in how far they carry the joints' errors. A few spheres of three
    poses do not speak for many of two.
    """
    away = lengths(points - np.repeat(centers, problem.counts, axis=0))
    several = np.repeat(problem.counts > 2, problem.counts) & judging
    if 2 * several.sum() < judging.sum():
        several = np.repeat(problem.counts > 1, problem.counts) & judging
    of_all = float(median(away[several if several.any() else judging]))
    usual = np.empty(len(away))
    for s in range(len(problem.keys)):
        rows = problem.rows(s)
        own = away[rows][judging[rows]]
        usual[rows] = np.clip(median(own) if len(own) else of_all, of_all, UNEVEN * of_all)
    return away, usual


def _judged_distances(
    problem: Problem, points: Array, kept: Mask, known: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """The size of each distance error (M,) and what certificate and poses allow it, m; `known` are
    the spheres' centres by the kept poses, and what is usual of all poses."""
    if known is None:
        centers = _centers(problem, points, kept)
        known = centers, _deviations(problem, points, centers, np.ones_like(kept))[1]
    centers, pose = known
    first, second = problem.pairs.T
    error = np.abs(np.linalg.norm(centers[first] - centers[second], axis=1) - problem.nominal)
    gauge = problem.measured.gauge
    certificate = np.array([gauge.distance_uncertainty(length) for length in problem.nominal])
    of_center = pose[problem.start[:-1]] / np.sqrt(problem.counts)
    of_poses = np.linalg.norm(of_center[problem.pairs], axis=1)
    return error, FAR * (certificate + of_poses) + LEAST_SIZE


def _moved_spheres(problem: Problem, error: Array, allowed: Array) -> Moved:
    """Spheres whose distances to the others of their location do not hold, by new placement:
    each has an `error` (M,) and is `allowed` one (M,), m."""
    if len(problem.pairs) < FEWEST_DISTANCES:
        return {}
    bad = error > np.maximum(FAR_DISTANCE * median(error) + LEAST_SIZE, allowed)
    moved: Moved = {}
    if not bad.any():
        return moved
    for rows in problem.locations:
        here = bad & np.isin(problem.pairs[:, 0], rows)
        for number, group in enumerate(_split(problem.pairs[here])):
            for row in group:
                location, sphere = map(int, problem.keys[row])
                moved[location, sphere] = number + 1
    return moved


def _split(bad: np.ndarray) -> list[list[int]]:
    """Spheres to set apart so that no bad pair is left together: those in most bad pairs first,
    and those set apart together as long as they agree among themselves."""
    apart: list[int] = []
    left = [tuple(map(int, pair)) for pair in bad]
    while left:
        involved = [sphere for pair in left for sphere in pair]
        worst = max(sorted(set(involved)), key=involved.count)
        apart.append(worst)
        left = [pair for pair in left if worst not in pair]
    if not apart:
        return []
    among = np.array([pair for pair in bad if pair[0] in apart and pair[1] in apart])
    further = _split(among.reshape(-1, 2))
    gone = {sphere for group in further for sphere in group}
    return [[sphere for sphere in apart if sphere not in gone], *further]


def _left_out(
    problem: Problem, points: Array, kept: Mask, away: Array, stretch: IntArray
) -> tuple[Rejected, ...]:
    centers = _centers(problem, points, kept)
    sphere_of = np.repeat(np.arange(len(problem.keys)), problem.counts)
    rejected = []
    for row in np.flatnonzero(~kept):
        own = int(sphere_of[row])
        location, sphere = (int(number) for number in problem.keys[own])
        reason = 'a stylus reads the same from pose to pose: stuck'
        if stretch[row] == 0:
            reason = _reason(problem, points[row], centers, own)
        number = int(problem.order[row]) + 1
        rejected.append(Rejected(number, location, sphere, float(away[row]), reason))
    return tuple(sorted(rejected, key=lambda one: one.pose))


def _reason(problem: Problem, point: Array, centers: Array, own: int) -> str:
    here = np.flatnonzero(problem.keys[:, 0] == problem.keys[own, 0])
    nearest = here[int(np.argmin(np.linalg.norm(centers[here] - point, axis=1)))]
    diameter = problem.measured.gauge.sphere_diameter
    if nearest != own and np.linalg.norm(centers[nearest] - point) < diameter / 2:
        return f'is at sphere {problem.keys[nearest, 1]}: mislabelled'
    return SLIPPED


def _warnings(rejected: tuple[Rejected, ...], moved: Moved, poses: int) -> tuple[str, ...]:
    warnings = []
    if rejected:
        worst = max(rejected, key=lambda one: one.size)
        warnings.append(
            f'{len(rejected)} of {poses} poses left out, the worst {worst.size * 1e3:.3f} mm off '
            f'(pose {worst.pose}, location {worst.location}, sphere {worst.sphere})'
        )
    for location in sorted({location for location, _ in moved}):
        spheres = ', '.join(str(sphere) for place, sphere in sorted(moved) if place == location)
        warnings.append(
            f'location {location}: sphere {spheres} is not where the certificate has it: '
            'mislabelled, or the gauge moved; its distances to the others are left out'
        )
    return tuple(warnings)
