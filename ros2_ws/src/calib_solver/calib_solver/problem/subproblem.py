# SPDX-License-Identifier: Apache-2.0
"""Parts of a problem: some of its spheres, a sphere as often as it is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from calib_model.arrays import frozen
from calib_solver.problem.problem import IntArray, Problem
from calib_solver.problem.sphere_sums import SphereSums

#: more locations than this are left out several at a time
MOST_FOLDS = 10


def take_groups(problem: Problem, groups: Sequence[IntArray]) -> Problem:
    """The problem of some groups of spheres, each group a location of its own.

    A group holds rows of `problem.keys` that were probed at one location; one that comes twice
    counts twice. Locations are numbered anew, from 1. Distances are those of the problem between
    spheres of one group.
    """
    rows = np.concatenate([np.sort(group) for group in groups])
    location = np.repeat(np.arange(1, len(groups) + 1), [len(group) for group in groups])
    keys = np.stack([location, problem.keys[rows, 1]], axis=1)
    poses = np.concatenate([np.arange(problem.start[s], problem.start[s + 1]) for s in rows])
    start = np.concatenate([[0], np.cumsum(problem.counts[rows])]).astype(np.int64)
    stood = np.stack([location, problem.placement[rows]], axis=1)
    placement = np.unique(stood, axis=0, return_inverse=True)[1].reshape(-1).astype(np.int64)
    pairs, nominal, pair_weight = [], [], []
    first = 0
    for group in groups:
        # where each of the problem's spheres is among those taken, -1 for the others
        place = np.full(len(problem.keys), -1, dtype=np.int64)
        place[np.sort(group)] = np.arange(first, first + len(group))
        own = place[problem.pairs]
        inside = (own >= 0).all(axis=1)
        pairs.append(own[inside])
        nominal.append(problem.nominal[inside])
        pair_weight.append(problem.pair_weight[inside])
        first += len(group)
    return replace(
        problem,
        keys=keys,
        start=start,
        order=problem.order[poses],
        joints=frozen(problem.joints[poses]),
        cosine=frozen(problem.cosine[:, poses]),
        sine=frozen(problem.sine[:, poses]),
        slide=frozen(problem.slide[:, poses]),
        centers=frozen(problem.centers[poses]),
        weight=frozen(problem.weight[poses]),
        placement=placement,
        pairs=np.concatenate(pairs).reshape(-1, 2),
        nominal=frozen(np.concatenate(nominal)),
        pair_weight=frozen(np.concatenate(pair_weight)),
    )


def location_folds(problem: Problem) -> list[IntArray]:
    """Rows of `problem.keys` to leave out in turn: one location each, or several of many."""
    groups = problem.locations
    count = min(len(groups), MOST_FOLDS)
    return [np.sort(np.concatenate(groups[i::count])) for i in range(count)]


@dataclass(frozen=True)
class Folds:
    """A problem and what is left out of it in turn; it is cut when first asked for, and once."""

    problem: Problem

    @cached_property
    def rows(self) -> list[IntArray]:
        """Rows of `problem.keys` that each fold leaves out."""
        return location_folds(self.problem)

    @cached_property
    def _kept(self) -> list[tuple[Problem, IntArray]]:
        every = np.arange(len(self.problem.keys))
        kept = [gathered(self.problem, np.setdiff1d(every, rows)) for rows in self.rows]
        return [(take_groups(self.problem, groups), np.concatenate(groups)) for groups in kept]

    def without(self, sums: SphereSums) -> list[tuple[Problem, SphereSums]]:
        """Of each fold the problem without it, and its part of the problem's sums."""
        return [(part, taken_sums(sums, rows)) for part, rows in self._kept]


def taken_sums(sums: SphereSums, rows: IntArray) -> SphereSums:
    """The sums of some spheres."""
    return SphereSums(*(getattr(sums, field.name)[rows] for field in fields(SphereSums)))


def merged_sums(sums: SphereSums, groups: Sequence[IntArray]) -> SphereSums:
    """The sums of spheres put together from the rows of each group."""
    merged = [_one(taken_sums(sums, rows)) for rows in groups]
    return SphereSums(
        *(np.stack([getattr(one, field.name) for one in merged]) for field in fields(SphereSums))
    )


def _one(sums: SphereSums) -> SphereSums:
    """Sums of several parts of one sphere as those of the whole."""
    count = sums.count.sum()
    share = sums.count / count
    center, jacobian = share @ sums.center, np.einsum('s,skf->kf', share, sums.jacobian)
    away, turned = sums.center - center, sums.jacobian - jacobian
    return SphereSums(
        count,
        center,
        jacobian,
        sums.spread.sum(axis=0) + sums.count @ away**2,
        sums.gradient.sum(axis=0) + np.einsum('s,sk,skf->f', sums.count, away, turned),
        sums.normal.sum(axis=0) + np.einsum('s,skf,skg->fg', sums.count, turned, turned),
    )


def gathered(problem: Problem, rows: IntArray) -> list[IntArray]:
    """Rows of `problem.keys` as groups, one for each location among them."""
    location = problem.keys[rows, 0]
    return [rows[location == number] for number in np.unique(location)]
