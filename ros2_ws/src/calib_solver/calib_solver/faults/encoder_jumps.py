# SPDX-License-Identifier: Apache-2.0
"""Encoders that jumped in mid-measurement, for good or for a while."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm
from calib_model.kinematics import ParameterTable, point_derivatives
from calib_model.measurement import Measurement, ProbingSet
from calib_solver.faults.residual_projection import TOLD, ResidualProjection
from calib_solver.problem import IntArray, Problem

#: a jump back has to explain so much of what a jump for good leaves
BETTER = 0.5
#: steps by which a large jump is closed in on, and how many joints are tried
STEPS, JOINTS = 8, 3
REFINED = 3
SMALL = 1e-6  # rad


@dataclass(frozen=True)
class Jump:
    """Joint number `joint`, from 0, reads `size` (rad, m) too much in poses `first` to `last`, from
    1; `last` None: from `first` on. It explains `share` of the residuals' variance."""

    share: float
    joint: int
    size: float
    first: int
    last: int | None

    def holds(self, when: IntArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Whether it is there at places (N,) of the measurement."""
        there: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = when + 1 >= self.first
        return there if self.last is None else there & (when + 1 <= self.last)

    def removed(self, poses: ProbingSet) -> ProbingSet:
        """All poses of the measurement without it."""
        there = self.holds(np.arange(len(poses), dtype=np.int64))
        return without(poses, self.joint, np.where(there, self.size, 0.0))

    def text(self, arm: Arm, pose_of: IntArray) -> str:
        """What it did; `pose_of` (N,) are the poses' places in the measurement as it was made."""
        size = f'{self.size * 1e3:+.3f} m{arm.joints[self.joint].unit}'
        text = f'jumped by {size} near pose {pose_of[self.first - 1] + 1}'
        return text if self.last is None else f'{text} and back near {pose_of[self.last - 1] + 1}'


def likely_jumps(
    residuals: ResidualProjection, moments: IntArray, joints: Iterable[int] | None = None
) -> list[Jump]:
    """The best jump of every joint, or of some `joints`, at some of the `moments` (K,), places in
    the measurement."""
    chosen = list(range(residuals.arm.n) if joints is None else joints)
    found = residuals.products_from(_by_joint(residuals)[:, :, chosen], moments)
    return [
        _best(residuals, joint, products, moments)
        for joint, products in zip(chosen, found, strict=True)
    ]


def _by_joint(residuals: ResidualProjection) -> Array:
    """How the points move with the joints, (N, 3, n), m/rad."""
    p_flange = residuals.probe.flange_T_probe.apply(residuals.p_probe)
    return point_derivatives(residuals.arm, residuals.joints, p_flange).joints


def _best(
    residuals: ResidualProjection,
    joint: int,
    products: tuple[Array, Array, Array],
    moments: IntArray,
) -> Jump:
    fits, among, whole = products
    square = np.diag(among).copy()
    told = square > TOLD * whole
    gain = np.where(told, fits**2 / np.where(told, square, 1.0), 0.0)
    best = int(np.argmax(gain))
    for_good = float(residuals.share(gain[best]))
    found = Jump(
        for_good,
        joint,
        float(fits[best] / square[best]) if told[best] else 0.0,
        int(moments[best]) + 1,
        None,
    )
    # there at one moment and back at another: the difference of two columns
    apart = square[:, None] + square - 2 * among
    both = np.triu(apart > TOLD * np.maximum(whole[:, None], whole), 1).astype(bool)
    twice = np.where(both, (fits[:, None] - fits) ** 2 / np.where(both, apart, 1.0), 0.0)
    a, b = np.unravel_index(int(np.argmax(twice)), twice.shape)
    for_a_while = float(residuals.share(twice[a, b]))
    if 1 - for_a_while > BETTER * (1 - for_good):
        return found
    size = float((fits[a] - fits[b]) / apart[a, b])
    return Jump(for_a_while, joint, size, int(moments[a]) + 1, int(moments[b]))


def large_jumps(measured: Measurement, table: ParameterTable, sigma: Array) -> list[Jump]:
    """Jumps of the joints that they explain most with, of any size, from the nominal arm on.

    A large one is no straight line: it is taken off and looked for again in what is left. `sigma`
    (F,) is what the free parameters usually are off by.
    """
    moments = np.arange(1, len(measured.poses), dtype=np.int64)
    first = likely_jumps(_at_nominal(measured, table, sigma), moments)
    likely = sorted(first, key=lambda jump: -jump.share)[:JOINTS]
    return [_closed_in_on(measured, table, sigma, jump.joint, moments) for jump in likely]


def _at_nominal(measured: Measurement, table: ParameterTable, sigma: Array) -> ResidualProjection:
    problem = Problem.of(measured)
    rows = np.arange(len(problem.joints), dtype=np.int64)
    return ResidualProjection(problem, table, measured.arm, measured.probe, rows, sigma)


def _closed_in_on(
    measured: Measurement, table: ParameterTable, sigma: Array, joint: int, moments: IntArray
) -> Jump:
    when = np.arange(len(measured.poses), dtype=np.int64)
    off: Array = np.zeros(len(when))
    for _ in range(STEPS):
        poses = without(measured.poses, joint, off)
        residuals = _at_nominal(replace(measured, poses=poses), table, sigma)
        (more,) = likely_jumps(residuals, moments, (joint,))
        off = off + more.size * more.holds(when)
        if abs(more.size) < SMALL:
            break
    # the first state is the one that counts as right
    off = off - off[0]
    largest = float(off[np.argmax(np.abs(off))])
    there = np.flatnonzero(off / largest > 0.5) if largest else np.array([], dtype=np.int64)
    if len(there) == 0:
        return Jump(0.0, joint, 0.0, 1, None)
    last = None if there[-1] == when[-1] else int(there[-1]) + 1
    return _sized(
        measured,
        table,
        sigma,
        Jump(0.0, joint, float(np.median(off[there])), int(there[0]) + 1, last),
    )


def _sized(measured: Measurement, table: ParameterTable, sigma: Array, jump: Jump) -> Jump:
    """The same jump with the size that explains most."""
    for _ in range(REFINED):
        poses = jump.removed(measured.poses)
        residuals = _at_nominal(replace(measured, poses=poses), table, sigma)
        by_joint = _by_joint(residuals)[:, :, jump.joint]
        by_jump = by_joint * jump.holds(residuals.when)[:, None]
        _, size = residuals.explained(by_jump[:, :, None])
        jump = replace(jump, size=jump.size + float(size[0]))
    return jump


def without(poses: ProbingSet, joint: int, off: Array) -> ProbingSet:
    """The poses with `off` (N,), rad, taken from a joint's readings."""
    joints = np.array(poses.joints)
    joints[:, joint] -= off
    return replace(poses, joints=joints)
