# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt on gradient and J'J, with a prior weighted by the noise the fit itself shows.

The prior's share of the cost is kappa * sum ((x - nominal) / sigma)^2. With kappa = phi / dof,
the mean square that a residual really has, this is the maximum a posteriori estimate; kappa
follows phi down, so noise-free data are fitted to the last digit whatever the prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calib_model.rotation import Array
from calib_solver.objectives import Quadratic

MOST_ITERATIONS = 60
#: a step is small when no parameter moves by more than this part of its scale
STEP_TOLERANCE = 1e-8
#: a gradient is small when following it to the bottom would gain less than this part of the cost
GAIN_TOLERANCE = 1e-12
#: lengths below this (m) are rounding: a residual of a metre-sized arm carries no more digits
ROUNDING = 2e-15
#: eigenvalues of the scaled J'J below this part of the largest cannot be told from rounding
RANK_TOLERANCE = 1e-14
#: damping, as a part of the largest eigenvalue: from next to Gauss-Newton to steepest descent
LEAST_DAMPING = 1e-14
MOST_DAMPING = 1e3


@dataclass(frozen=True)
class Fit:
    """Where the iteration ended: `x` (F,) about nominal, the objective there without the prior,
    the prior's weight `kappa`, and why it stopped."""

    x: Array
    quadratic: Quadratic
    kappa: float
    phi_initial: float
    iterations: int
    evaluations: int
    converged: bool
    reason: str
    history: tuple[float, ...] = field(default=())


def minimise(
    evaluate: Callable[[Array], Quadratic], start: Array, scale: Array, information: Array
) -> Fit:
    """Minimise phi(x) + kappa x'diag(information)x from `start` (F,).

    `evaluate(x)` gives the objective at offsets x from the nominal values; `scale` (F,) is each
    parameter's natural size (m, rad), in which steps are damped and judged.
    """
    state = _State(evaluate, scale, information, start)
    damping = LEAST_DAMPING
    reason = 'no free parameters'
    converged = len(start) == 0
    while not converged and state.iterations < MOST_ITERATIONS:
        state.iterations += 1
        step, gain = state.step(damping)
        small = np.abs(step / scale).max() <= STEP_TOLERANCE if len(step) else True
        if gain <= GAIN_TOLERANCE * state.cost + state.rounding and small:
            converged, reason = True, 'gradient and step below their tolerances'
            state.try_step(step, gain)
            break
        if state.try_step(step, gain):
            damping = max(damping / 10, LEAST_DAMPING)
        elif damping > MOST_DAMPING:
            reason = 'no step lowers the cost any more'
            converged = gain <= 1e-9 * state.cost + state.rounding
            break
        else:
            damping *= 100
    else:
        if not converged:
            reason = f'stopped after {MOST_ITERATIONS} iterations'
    return Fit(
        state.x, state.quadratic, state.kappa, state.phi_initial, state.iterations,
        state.evaluations, converged, reason, tuple(state.history),
    )  # fmt: skip


class _State:
    """The iterate with its cost; the prior's weight follows the objective."""

    def __init__(
        self, evaluate: Callable[[Array], Quadratic], scale: Array, information: Array, start: Array
    ) -> None:
        self.evaluate = evaluate
        self.scale = scale
        self.information = information
        self.iterations = 0
        self.evaluations = 1
        self.x = start
        self.quadratic = evaluate(start)
        self.phi_initial = self.quadratic.phi
        self.kappa = self._noise(self.quadratic)
        self.history = [self.phi_initial]

    def _noise(self, quadratic: Quadratic) -> float:
        """phi per degree of freedom; with none to spare, phi shared by all residuals."""
        freedom = quadratic.terms - len(self.x)
        return quadratic.phi / max(freedom, 1.0)

    @property
    def cost(self) -> float:
        """Objective and prior together."""
        return self._cost(self.quadratic, self.x)

    @property
    def rounding(self) -> float:
        """The part of the cost that is rounding, m^2."""
        return float(max(self.quadratic.terms, 1.0) * ROUNDING**2)

    def _cost(self, quadratic: Quadratic, x: Array) -> float:
        return quadratic.phi + self.kappa * float(self.information @ x**2)

    def step(self, damping: float) -> tuple[Array, float]:
        """The damped step (F,) in the scaled eigenbasis, and the cost it should gain."""
        prior = self.kappa * self.information
        gradient = self.scale * (self.quadratic.gradient + prior * self.x)
        normal = self.scale[:, None] * self.quadratic.normal * self.scale
        normal[np.diag_indices_from(normal)] += prior * self.scale**2
        values, vectors = np.linalg.eigh(normal)
        largest = max(float(values[-1]), 1e-300)
        seen = values > RANK_TOLERANCE * largest
        along = vectors.T @ gradient
        share = np.where(seen, along / np.where(seen, values + damping * largest, 1.0), 0.0)
        gain = float(share @ (2 * along - values * share))
        return -self.scale * (vectors @ share), gain

    def try_step(self, step: Array, gain: float) -> bool:
        """Take the step if it lowers the cost by a fair part of what it promised."""
        candidate = self.x + step
        quadratic = self.evaluate(candidate)
        self.evaluations += 1
        lowered = self.cost - self._cost(quadratic, candidate)
        # at the bottom both are rounding, and an equal cost is as good
        rounding = abs(lowered) <= self.rounding and gain <= self.rounding
        if not np.isfinite(quadratic.phi) or not (rounding or lowered >= 1e-4 * gain):
            return False
        self.x, self.quadratic = candidate, quadratic
        self.kappa = self._noise(quadratic)
        self.history.append(quadratic.phi)
        return True
