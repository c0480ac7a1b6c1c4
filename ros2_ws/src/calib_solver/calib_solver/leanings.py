# SPDX-License-Identifier: Apache-2.0
"""Leanings: residuals that are mostly one known fault's shadow.

After the fit the deviations are held against what a wrong gain of a stylus, or an encoder that
jumped in mid-measurement, would have left in them. What the identified parameters could have taken
up is set aside first, so a fault is named only for what nothing else explains. The distance errors
are held against one sphere being elsewhere than its certificate says.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from calib_model.arm import Arm
from calib_model.jacobian import probing_jacobian
from calib_model.kinematics import point_derivatives
from calib_model.parameters import ParameterTable
from calib_model.probe import ActiveProbe, Probe
from calib_model.rotation import Array
from calib_solver.problem import IntArray, Problem

#: so many poses are looked at, and so many moments at which an encoder may have jumped
POSES, MOMENTS = 1000, 60
#: a fault is named when it alone explains this share of the residuals' variance
SHARE = 0.5
#: distance errors are fewer and lean more easily
SHARE_OF_DISTANCES = 0.7
#: too few poses or distances let anything explain everything
FEWEST, FEWEST_DISTANCES = 100, 12
#: spheres nearer to one line than this say nothing about places beside it
FLAT = 0.05
STEP = 1e-7  # m, for the derivative by a reading


@dataclass(frozen=True)
class Leaning:
    """A fault that explains `share` of the residuals' variance."""

    share: float
    text: str


def named_leanings(
    problem: Problem, table: ParameterTable, arm: Arm, probe: Probe
) -> tuple[str, ...]:
    """A line for the fault that explains most of the deviations (3 N,), if any does."""
    rows = np.linspace(0, len(problem.joints) - 1, POSES).astype(np.int64)
    rows = np.unique(rows)
    if len(rows) < FEWEST:
        return ()
    residuals = _Residuals(problem, table, arm, probe, rows)
    best = max(_leanings(residuals), key=lambda one: one.share)
    if best.share < SHARE:
        return ()
    return (f'{best.text}: that alone explains {best.share:.0%} of the residuals',)


def named_sphere(problem: Problem, center: Array, misfit: float) -> tuple[str, ...]:
    """A line for the sphere whose certified centre is wrong, if that explains most distance errors.

    `center` (S, 3), m, are the probed spheres' centres with the identified parameters; `misfit` is
    how many times larger the errors are than the poses' noise and the certificate make them.
    """
    if misfit < 2 or len(problem.pairs) < FEWEST_DISTANCES:
        return ()
    between = center[problem.pairs[:, 0]] - center[problem.pairs[:, 1]]
    error = np.linalg.norm(between, axis=1) - problem.nominal
    gauge = problem.measured.gauge
    found = Leaning(0.0, '')
    for number in np.unique(problem.keys[:, 1]):
        by_center = np.zeros((len(error), 3))
        for row, (i, j) in enumerate(problem.keys[problem.pairs, 1]):
            apart = gauge.center(int(i)) - gauge.center(int(j))
            by_center[row] = (float(i == number) - float(j == number)) * apart
        by_center /= problem.nominal[:, None]
        shift, _, rank, _ = np.linalg.lstsq(by_center, error, rcond=FLAT)
        share = 1 - float(((error - by_center @ shift) ** 2).sum() / (error @ error))
        if rank and share > found.share:
            size = float(np.linalg.norm(shift))
            found = Leaning(share, f'sphere {number} is {size * 1e3:.4f} mm from its place')
    if found.share < SHARE_OF_DISTANCES:
        return ()
    return (
        f'{found.text} on the certificate at every location: that alone explains '
        f'{found.share:.0%} of the distance errors',
    )


class _Residuals:
    """Deviations of some poses from their spheres' means, free of what the parameters can do."""

    def __init__(
        self, problem: Problem, table: ParameterTable, arm: Arm, probe: Probe, rows: IntArray
    ) -> None:
        self.joints, self.p_probe = problem.joints[rows], problem.centers[rows]
        self.arm, self.probe = arm, probe
        self.when = problem.order[rows]
        self.measured = problem.measured
        sphere = np.repeat(np.arange(len(problem.counts)), problem.counts)[rows]
        self._start = np.flatnonzero(np.diff(sphere, prepend=-1))
        self._count = np.diff(self._start, append=len(rows))
        p_base, jacobian = probing_jacobian(arm, probe, self.joints, self.p_probe)
        free = self._centred(jacobian[:, :, table.free_columns])
        scale = np.linalg.norm(free, axis=0)
        known, size, _ = np.linalg.svd(free / np.where(scale > 0, scale, 1), full_matrices=False)
        self._known = known[:, size > 1e-9 * size.max(initial=0.0)]
        self.left = self._unknown(self._centred(p_base))

    def explained(self, by_fault: Array) -> tuple[Array, Array]:
        """The share of the variance that each fault explains, and its size, both (F,).

        `by_fault` (N, 3, F) is what each does to the points, m a unit.
        """
        columns = self._unknown(self._centred(by_fault))
        square = (columns**2).sum(axis=0)
        told = square > 1e-12 * (by_fault**2).sum(axis=(0, 1))
        whole = float(self.left @ self.left)
        size = np.where(told, columns.T @ self.left / np.where(told, square, 1), 0)
        return size**2 * square / (whole if whole > 0 else 1), size

    def _centred(self, values: Array) -> Array:
        """Minus the mean of the pose's sphere; (N, 3, ...) becomes (3 N, ...)."""
        flat = values.reshape(len(values), -1)
        mean = np.add.reduceat(flat, self._start, axis=0) / self._count[:, None]
        flat = flat - np.repeat(mean, self._count, axis=0)
        return flat.reshape(3 * len(values), *values.shape[2:])

    def _unknown(self, column: Array) -> Array:
        left: Array = column - self._known @ (self._known.T @ column)
        return left


def _leanings(residuals: _Residuals) -> Iterator[Leaning]:
    yield Leaning(0.0, '')
    if isinstance(residuals.probe, ActiveProbe):
        yield from _gains(residuals, residuals.probe)
    yield from _jumps(residuals)


def _gains(residuals: _Residuals, probe: ActiveProbe) -> Iterator[Leaning]:
    """Each stylus' reading off by a factor."""
    diameter = residuals.measured.gauge.sphere_diameter
    read = residuals.measured.poses.displacement[residuals.when]
    flange = point_derivatives(residuals.arm, residuals.joints, residuals.p_probe).flange
    turn = flange @ probe.flange_T_probe.rotation
    by_gain = np.empty((*read.shape, 3))
    for stylus in range(3):
        moved = np.array(read)
        moved[:, stylus] += STEP
        by_reading = (probe.centers(moved, diameter) - residuals.p_probe) / STEP
        by_gain[:, :, stylus] = np.einsum('nij,nj->ni', turn, by_reading * read[:, [stylus]])
    for stylus, (share, size) in enumerate(zip(*residuals.explained(by_gain), strict=True)):
        much = 'much' if size > 0 else 'little'
        yield Leaning(share, f'stylus {stylus + 1} reads {abs(size):.2%} too {much}')


def _jumps(residuals: _Residuals) -> Iterator[Leaning]:
    """Each encoder jumping once, at one of some moments."""
    derivatives = point_derivatives(
        residuals.arm, residuals.joints,
        residuals.probe.flange_T_probe.apply(residuals.p_probe),
    ).joints  # fmt: skip
    order = np.argsort(residuals.when, kind='stable')
    moments = np.unique(np.linspace(2, len(order) - 2, MOMENTS).astype(np.int64))
    after = residuals.when[:, None] >= residuals.when[order[moments]]
    for joint, name in enumerate(residuals.arm.joint_names):
        by_jump = derivatives[:, :, joint, None] * after[:, None, :]
        share, size = residuals.explained(by_jump)
        best = int(np.argmax(share))
        pose = int(residuals.when[order[moments[best]]]) + 1
        text = f'joint {name} jumped by {size[best] * 1e3:+.3f} mrad near pose {pose}'
        yield Leaning(float(share[best]), text)
