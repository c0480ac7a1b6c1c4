# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt on gradient and J'J, with a prior weighted by the noise the fit itself shows.

The prior's share of the cost is kappa * sum ((x - nominal) / sigma)^2. With kappa the mean square
that a residual really has, this is the maximum a posteriori estimate. That mean square is what
would be left of phi if every parameter went where the data pull it, so the prior cannot feed on
its own bias, and noise-free data are fitted to the last digit whatever the prior.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting.objectives import Quadratic

#: few poses leave a narrow, bent valley of parameters that all but fit them: a long way down
MOST_ITERATIONS = 400
#: a step is small when no parameter moves by more than this part of its scale
STEP_TOLERANCE = 1e-8
#: a gradient is small when following it to the bottom would gain less than this part of the cost
GAIN_TOLERANCE = 1e-12
#: the same where a fit is only a stage on the way to another one
ROUGH_STEP, ROUGH_GAIN = 1e-3, 1e-6
#: lengths below this (m) are rounding: a residual of a metre-sized arm carries no more digits
ROUNDING = 2e-15
#: singular values of the scaled J below these parts of the largest are rounding: of J'J, whose
#: eigenvalues are their squares, and of J itself where the objective gives its rows
NORMAL_TOLERANCE = 1e-7
ROWS_TOLERANCE = 1e-13
#: eigenvalues of the scaled J'J below this part of the largest, where it is solved once
LINEAR_TOLERANCE = 1e-13
#: damping, as a part of the largest singular value: from next to Gauss-Newton to steepest descent
LEAST_DAMPING = 1e-24
#: so many full steps on end that gain nothing but rounding say that no more is to be had
MOST_IDLE = 3
MOST_DAMPING = 1e2
#: why a fit has converged
SETTLED = 'gradient and step below their tolerances'

Evaluate = Callable[[Array], Quadratic]


@dataclass(frozen=True)
class Modes:
    """The scaled J's singular values (F,), largest first, and right vectors (F, F) as columns;
    `along` (F,) is the scaled gradient in them, `seen` (F,) which stand out from rounding."""

    values: Array
    vectors: Array
    along: Array
    seen: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def modes(quadratic: Quadratic, scale: Array, information: Array, offset: Array) -> Modes:
    """The modes of an objective with a prior of `information` (F,) about `offset` (F,) away.

    Taken from J's rows where the objective gives them, which sees singular values down to
    rounding, else from J'J, which sees half as many digits.
    """
    prior = np.sqrt(information) * scale
    if quadratic.rows is None:
        normal = scale[:, None] * quadratic.normal * scale
        normal[np.diag_indices_from(normal)] += prior**2
        squares, vectors = np.linalg.eigh(normal)
        values = np.sqrt(np.maximum(squares[::-1], 0.0))
        vectors = vectors[:, ::-1]
        along = vectors.T @ (scale * (quadratic.gradient + information * offset))
        tolerance = NORMAL_TOLERANCE
    else:
        slope, residual = quadratic.rows
        stacked = np.concatenate([slope * scale, np.diag(prior)])
        u, values, vt = np.linalg.svd(stacked, full_matrices=False)
        vectors = vt.T
        along = values * (u.T @ np.concatenate([residual, np.sqrt(information) * offset]))
        tolerance = ROWS_TOLERANCE
    return Modes(values, vectors, along, values > tolerance * values.max(initial=1e-300))


def linear_step(normal: Array, gradient: Array, prior: Array, about: Array) -> Array:
    """The step (F,) to the minimum of an objective with J'J `normal` (F, F) and J'r `gradient`
    (F,), taken as linear; a prior adds `prior` (F,) to J'J, about offsets -`about` (F,) from here.
    """
    normal, gradient = normal + np.diag(prior), gradient + prior * about
    size = np.maximum(np.diag(normal), 1e-300)
    if (prior > LINEAR_TOLERANCE * size).all():
        direct = -np.linalg.solve(normal, gradient)
        return np.asarray(direct, dtype=np.float64)
    scale = np.where(np.diag(normal) > 0, 1 / np.sqrt(size), 0.0)
    values, vectors = np.linalg.eigh(scale[:, None] * normal * scale)
    kept = values > LINEAR_TOLERANCE * values.max(initial=1e-300)
    along = (vectors[:, kept].T @ (scale * gradient)) / values[kept]
    step: Array = -scale * (vectors[:, kept] @ along)
    return step


@dataclass(frozen=True)
class Fit:
    """Where the iteration ended: `x` (F,) about nominal, the objective there without the prior,
    the prior's weight `kappa`, and why it stopped. `unseen` (F, U) are scaled directions that
    neither the data nor the prior hold; with any, `converged` is false."""

    x: Array
    quadratic: Quadratic
    kappa: float
    phi_initial: float
    iterations: int
    evaluations: int
    converged: bool
    reason: str
    unseen: Array
    history: tuple[float, ...] = field(default=())

    @property
    def verdict(self) -> str:
        """How it went, in one line."""
        outcome = 'converged' if self.converged else 'NOT CONVERGED'
        return f'{outcome} after {self.iterations} iterations: {self.reason}'


def residual_noise(quadratic: Quadratic, scale: Array, least: float = 0.0) -> float:
    """A residual's mean square, m^2: phi less what the data alone would still gain, per degree of
    freedom, and no less than `least`; `scale` (F,) as in `minimise`."""
    free = len(scale)
    freedom = quadratic.terms - free
    if freedom < 1:
        return max(quadratic.phi / max(quadratic.terms, 1.0), least)
    zero = np.zeros(free)
    alone = modes(quadratic, scale, zero, zero)
    within = alone.along[alone.seen] / alone.values[alone.seen]
    left = max(quadratic.phi - float(within @ within), 0.0) / freedom
    return max(left, least)


def minimise(
    evaluate: Evaluate,
    start: Array,
    scale: Array,
    information: Array,
    least_noise: float = 0.0,
    kappa: float | None = None,
    rough: bool = False,
) -> Fit:
    """Minimise phi(x) + kappa x'diag(information)x from `start` (F,).

    `evaluate(x)` gives the objective at offsets x from the nominal values; `scale` (F,) is each
    parameter's natural size (m, rad), in which steps are damped and judged; `least_noise` (m^2) is
    a residual's mean square as known from elsewhere, below which kappa does not go. A `kappa` that
    is given stays what it is. A `rough` minimum is where another fit goes on from: its last step is
    left to that one.
    """
    state = _State(evaluate, scale, information, start, least_noise, kappa)
    if len(start) == 0:
        return state.fit(True, 'no free parameters')
    damping = LEAST_DAMPING
    least_step = (ROUGH_STEP if rough else STEP_TOLERANCE) * scale
    least_gain = ROUGH_GAIN if rough else GAIN_TOLERANCE
    idle = 0
    while state.iterations < MOST_ITERATIONS:
        state.iterations += 1
        step, gain = state.step(damping)
        idle = idle + 1 if damping == LEAST_DAMPING and gain <= state.rounding else 0
        if (np.abs(step) <= least_step).all() and gain <= least_gain * state.cost + state.rounding:
            if rough or not state.try_step(step, gain):
                return state.fit(True, SETTLED)
            # where it ends the step is to be small too, and not by the luck of rounding
            if (np.abs(state.step(damping)[0]) <= least_step).all():
                return state.fit(True, SETTLED)
            continue
        if idle > MOST_IDLE:
            return state.fit(False, 'only rounding is left to gain; a direction does not settle')
        if state.try_step(step, gain):
            damping = max(damping / 100, LEAST_DAMPING)
        elif damping > MOST_DAMPING:
            flat = gain <= 1e-9 * state.cost + state.rounding
            return state.fit(flat, 'no step lowers the cost any more')
        else:
            damping *= 100
    return state.fit(False, f'stopped after {MOST_ITERATIONS} iterations')


class _State:
    """The iterate with its cost; the prior's weight follows the objective."""

    def __init__(
        self,
        evaluate: Evaluate,
        scale: Array,
        information: Array,
        start: Array,
        least: float,
        kappa: float | None,
    ) -> None:
        self.evaluate = evaluate
        self.scale = scale
        self.information = information
        self.least_noise = least
        self.iterations = 0
        self.evaluations = 1
        self.x = start
        self.quadratic = evaluate(start)
        self.phi_initial = self.quadratic.phi
        self.follows = kappa is None
        self.kappa = self._noise(self.quadratic) if kappa is None else kappa
        self.history = [self.phi_initial]
        self._modes: Modes | None = None

    def _noise(self, quadratic: Quadratic) -> float:
        return residual_noise(quadratic, self.scale, self.least_noise)

    @property
    def cost(self) -> float:
        """Objective and prior together."""
        return self._cost(self.quadratic, self.x)

    @property
    def rounding(self) -> float:
        """The part of the cost that is rounding, m^2."""
        least = float(max(self.quadratic.terms, 1.0) * ROUNDING**2)
        return max(least, self.quadratic.rounding)

    def _cost(self, quadratic: Quadratic, x: Array) -> float:
        return quadratic.phi + self.kappa * float(self.information @ x**2)

    def modes(self) -> Modes:
        """The modes at the iterate."""
        if self._modes is None:
            prior = self.kappa * self.information
            self._modes = modes(self.quadratic, self.scale, prior, self.x)
        return self._modes

    def step(self, damping: float) -> tuple[Array, float]:
        """The damped step (F,) along the modes that are seen, and the cost it should gain."""
        now = self.modes()
        squares = now.values**2
        damped = np.where(now.seen, squares + damping * squares[0], 1.0)
        share = np.where(now.seen, now.along / damped, 0.0)
        gain = float(share @ (2 * now.along - squares * share))
        return -self.scale * (now.vectors @ share), gain

    def try_step(self, step: Array, gain: float) -> bool:
        """Take the step if it lowers the cost by a fair part of what it promised."""
        candidate = self.x + step
        quadratic = self.evaluate(candidate)
        self.evaluations += 1
        if not np.isfinite(quadratic.phi):
            return False
        lowered = self.cost - self._cost(quadratic, candidate)
        # at the bottom both are rounding, and an equal cost is as good
        rounding = abs(lowered) <= self.rounding and gain <= self.rounding
        if not (rounding or lowered >= 1e-4 * gain):
            return False
        self.x, self.quadratic = candidate, quadratic
        if self.follows:
            self.kappa = self._noise(quadratic)
        self.history.append(quadratic.phi)
        self._modes = None
        return True

    def fit(self, converged: bool, reason: str) -> Fit:
        """The iterate as the result."""
        now = self.modes()
        unseen = now.vectors[:, ~now.seen]
        if unseen.shape[1]:
            converged = False
            reason = f'{unseen.shape[1]} directions are told neither by the poses nor by the prior'
        return Fit(
            self.x,
            self.quadratic,
            self.kappa,
            self.phi_initial,
            self.iterations,
            self.evaluations,
            converged,
            reason,
            unseen,
            tuple(self.history),
        )
