# SPDX-License-Identifier: Apache-2.0
"""What the parameters cannot explain of where the poses lie, to first order.

A pose's residual is how far its point is from the mean of its sphere's. What the free parameters
could still take up is projected out of residuals and of what a fault would do to them, so that a
fault is held against that alone which nothing else explains.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import ParameterTable, probing_jacobian
from calib_solver.problem import IntArray, Problem

#: residuals of this size (m) pull as much as a parameter that is off by its standard deviation
USUAL = 1e-3
#: of what a fault does, the part (of its square) that no parameter does is rounding below this
TOLD = 1e-9


class ResidualProjection:
    """Residuals of the poses `rows` (N,) of a problem, free of what the parameters can do.

    `joints` (N, n) and `p_probe` (N, 3) are theirs, `when` (N,) their places in the measurement,
    `left` the residuals, m: (3 N,), or (3 N + F,) where `sigma` (F,) holds the free parameters.
    Unheld they explain any residuals that are large: an arm of no size is at one place always.
    """

    def __init__(
        self,
        problem: Problem,
        table: ParameterTable,
        arm: Arm,
        probe: Probe,
        rows: IntArray,
        sigma: Array | None = None,
    ) -> None:
        self.joints, self.p_probe = problem.joints[rows], problem.centers[rows]
        self.arm, self.probe = arm, probe
        self.when = problem.order[rows]
        self.measured = problem.measured
        self._by_sphere = _BySphere(problem, rows)
        p_base, jacobian = probing_jacobian(arm, probe, self.joints, self.p_probe)
        free = self._by_sphere.centred(jacobian[:, :, table.free_columns])
        scale = np.linalg.norm(free, axis=0) if sigma is None else 1 / sigma
        free = free / np.where(scale > 0, scale, 1)
        self._holding = 0 if sigma is None else len(sigma)
        if sigma is not None:
            free = np.concatenate([free, USUAL * np.eye(len(sigma))])
        known, size, _ = np.linalg.svd(free, full_matrices=False)
        self._known = known[:, size > 1e-9 * size.max(initial=0.0)]
        self.left = self._unknown(self._by_sphere.centred(p_base))

    def products(self, by_fault: Array) -> tuple[Array, Array, Array]:
        """Of what faults (N, 3, F), m a unit each, do that no parameter can: the products with the
        residuals (F,) and with one another (F, F); and the squares (F,) of all that they do."""
        columns = self._by_sphere.centred(by_fault)
        known = self._known[: len(columns)].T @ columns
        among = columns.T @ columns - known.T @ known
        whole = np.einsum('nkf,nkf->f', by_fault, by_fault)
        return columns.T @ self.left[: len(columns)], among, whole

    def products_of_shifts(self, there: NDArray[np.bool_]) -> tuple[Array, Array]:
        """What `products` says of shifting the points along x, y and z, each time of the poses that
        are `there` (K, N): with the residuals (K, 3) and among themselves (K, 3, 3)."""
        shifted, count = there.astype(np.float64), there.shape[1]
        fits = shifted @ self.left[: 3 * count].reshape(count, 3)
        known = shifted @ self._known[: 3 * count].reshape(count, -1)
        known = known.reshape(len(shifted), 3, -1)
        square = self._by_sphere.squares(shifted)[:, None, None] * np.eye(3)
        return fits, square - known @ np.swapaxes(known, 1, 2)

    def products_from(self, fault: Array, moments: IntArray) -> list[tuple[Array, Array, Array]]:
        """The `products` of each fault (N, 3, J), m a unit, that is there from one of `moments`
        (K,) on, ascending places in the measurement: columns by moment are sums of fewer and fewer
        poses, so that running sums tell their products, J times (K,), (K, K), (K,)."""
        count, faults = len(fault), fault.shape[2]

        def later(values: Array) -> Array:
            return sums_from(values, self.when, moments)

        # what is centred has the same product with a column as with the centred column
        known = self._known[: 3 * count].reshape(count, 3, -1)
        by_known = later(np.einsum('nkr,nkj->nrj', known, fault))
        fits = later(np.einsum('nk,nkj->nj', self.left[: 3 * count].reshape(count, 3), fault))
        square = later(np.einsum('nkj,nkj->nj', fault, fault))
        mean = self._by_sphere.later_means(fault, self.when, moments)
        found = []
        # the poses that two of them share are those of the later
        both = np.maximum.outer(np.arange(len(moments)), np.arange(len(moments)))
        for j in range(faults):
            among = square[both, j]
            among = (
                among - mean[:, :, j].T @ mean[:, :, j] - by_known[:, :, j] @ by_known[:, :, j].T
            )
            found.append((fits[:, j], among, square[:, j]))
        return found

    def explained(self, by_fault: Array) -> tuple[Array, Array]:
        """The share of the residuals' variance that each fault explains, and its size, (F,)."""
        fits, among, whole = self.products(by_fault)
        told = np.diag(among) > TOLD * whole
        square = np.where(told, np.diag(among), 1.0)
        size = np.where(told, fits / square, 0.0)
        return self.share(size**2 * square), size

    def share(self, square: Array) -> Array:
        """Of the residuals' sum of squares, the share that is `square`."""
        whole = float(self.left @ self.left)
        return square / (whole if whole > 0 else 1.0)

    def _unknown(self, column: Array) -> Array:
        held = np.zeros((self._holding, *column.shape[1:]))
        column = np.concatenate([column, held])
        left: Array = column - self._known @ (self._known.T @ column)
        return left


def rough_spread(problem: Problem, table: ParameterTable, sigma: Array) -> float:
    """About how far (m, rms) poses would lie from their sphere's mean after a fit: one step from
    the nominal parameters, which `sigma` (F,) holds from going anywhere."""
    measured = problem.measured
    rows = np.arange(len(problem.joints), dtype=np.int64)
    p_base, jacobian = probing_jacobian(
        measured.arm, measured.probe, problem.joints, problem.centers
    )
    by_sphere = _BySphere(problem, rows)
    residual = by_sphere.centred(p_base)
    slope = by_sphere.centred(jacobian[:, :, table.free_columns]) * sigma
    gradient = slope.T @ residual
    step = np.linalg.solve(slope.T @ slope + USUAL**2 * np.eye(len(sigma)), gradient)
    cost = float(residual @ residual - gradient @ step)
    return float(np.sqrt(max(cost, 0.0) / len(rows)))


def sums_from(values: Array, when: IntArray, moments: IntArray) -> Array:
    """Sums (K, ...) of values (N, ...) that came at `when` (N,), from each moment (K,) on."""
    in_time = np.argsort(when, kind='stable')
    running = np.cumsum(values[in_time[::-1]], axis=0)[::-1]
    ended = np.concatenate([running, np.zeros((1, *values.shape[1:]))])
    sums: Array = ended[np.searchsorted(when[in_time], moments)]
    return sums


class _BySphere:
    """Rows of poses sphere by sphere."""

    def __init__(self, problem: Problem, rows: IntArray) -> None:
        sphere = np.repeat(np.arange(len(problem.counts)), problem.counts)[rows]
        self._start = np.flatnonzero(np.diff(sphere, prepend=-1))
        self._count = np.diff(self._start, append=len(rows))

    def centred(self, values: Array) -> Array:
        """Minus the mean of the pose's sphere; (N, 3, ...) becomes (3 N, ...)."""
        flat = values.reshape(len(values), -1)
        mean = np.add.reduceat(flat, self._start, axis=0) / self._count[:, None]
        flat = flat - np.repeat(mean, self._count, axis=0)
        return flat.reshape(3 * len(values), *values.shape[2:])

    def squares(self, values: Array) -> Array:
        """Sums (K,) of the squares of values (K, N), each minus the mean of the pose's sphere."""
        sums = np.add.reduceat(values, self._start, axis=1)
        squares: Array = (values**2).sum(axis=1) - (sums**2 / self._count).sum(axis=1)
        return squares

    def later_means(self, values: Array, when: IntArray, moments: IntArray) -> Array:
        """Of values (N, 3, J) each sphere's mean over its poses from each of `moments` (K,) on, the
        earlier ones taken as zero, times the root of its count: (3 S, K, J)."""
        found: Array = np.zeros((len(self._start), 3, len(moments), values.shape[2]))
        for row, (start, count) in enumerate(zip(self._start, self._count, strict=True)):
            own = slice(start, start + count)
            later = sums_from(values[own], when[own], moments)
            found[row] = np.swapaxes(later, 0, 1) / np.sqrt(count)
        return found.reshape(-1, len(moments), values.shape[2])
