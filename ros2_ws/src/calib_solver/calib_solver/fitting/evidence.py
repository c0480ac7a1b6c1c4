# SPDX-License-Identifier: Apache-2.0
"""How wide the prior is by the data themselves: MacKay's evidence, for each kind of parameter.

D. J. C. MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415-447: where the data tell a
parameter (gamma near 1) its offset says how wide its kind is, where they do not it says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.levenberg_marquardt import (
    Evaluate,
    Fit,
    minimise,
    residual_noise,
)
from calib_solver.fitting.objectives import Quadratic
from calib_solver.problem import IntArray

#: where widths begin, as so many times what is usual: nothing is held that the data could tell
WEAK = 10.0
#: m, what a residual is held to be until a first minimum shows it: little, so that a start far off
#: is no reason to stay there
FIRST_NOISE = 1e-4
#: m, below which a residual says nothing more of the widths
LEAST_NOISE = 1e-8
#: widths are settled when none changes by more than this part
SETTLED = 0.02
MOST_ROUNDS = 6
MOST_UPDATES = 50
#: no width leaves this span of what is usual
NARROWEST, WIDEST = 1e-3, 1e4


@dataclass(frozen=True)
class Group:
    """Free parameters that have a width in common: `sigma` (F,) is what each usually is off by (m,
    rad), `kind` (F,) the number of its kind, from 0."""

    sigma: Array
    kind: IntArray

    def information(self, times: Array) -> Array:
        """1 / (times sigma)^2 of every parameter (F,), by the `times` (K,) of the kinds."""
        information: Array = 1 / (times[self.kind] * self.sigma) ** 2
        return information


def groups(table: ParameterTable, sigma: Array) -> tuple[tuple[str, ...], Group]:
    """The kinds (K,) of a table's free parameters, and these by kind; `sigma` (F,) as in `Group`."""
    kinds = tuple(dict.fromkeys(parameter.kind for parameter in table.free))
    kind = [kinds.index(parameter.kind) for parameter in table.free]
    return kinds, Group(sigma, np.array(kind, dtype=np.int64))


def widths(
    quadratic: Quadratic, x: Array, kappa: float, group: Group, times: Array
) -> tuple[Array, float]:
    """By how many times (K,) the parameters of each kind are off what is usual, and the logarithm
    of the evidence for that.

    The objective is taken as `quadratic` about offsets `x` (F,), `kappa` (m^2) is a residual's mean
    square; begun from `times` (K,). One offset as large as usual counts as seen beforehand of each
    kind, so that nothing told leaves it at 1.
    """
    noise = max(kappa, LEAST_NOISE**2)
    sigma, kind = group.sigma, group.kind
    normal = sigma[:, None] * quadratic.normal * sigma / noise
    right = normal @ (x / sigma) - sigma * quadratic.gradient / noise
    told: Array = np.zeros(len(x))
    offset: Array = np.zeros(len(x))
    for _ in range(MOST_UPDATES):
        held = times[kind]
        root = held[:, None] * normal * held
        covariance = held[:, None] * np.linalg.inv(root + np.eye(len(x))) * held
        offset = covariance @ right
        told = 1 - np.diag(covariance) / held**2
        before = times
        square = np.bincount(kind, offset**2, len(times)) + 1
        times = np.sqrt(square / (np.bincount(kind, np.maximum(told, 0.0), len(times)) + 1))
        times = np.clip(times, NARROWEST, WIDEST)
        if np.abs(np.log(times / before)).max(initial=0.0) < SETTLED / 2:
            break
    held = times[kind]
    _, size = np.linalg.slogdet(held[:, None] * normal * held + np.eye(len(x)))
    left = offset - x / sigma
    phi = quadratic.phi / noise + 2 * float(left @ (sigma * quadratic.gradient)) / noise
    phi += float(left @ normal @ left)
    evidence = phi + float((offset / held) @ (offset / held)) + size
    evidence += quadratic.terms * float(np.log(noise))
    return times, -0.5 * evidence


@dataclass(frozen=True)
class Settled:
    """The last of several `fits`, at widths of `times` (K,) what is usual, and the logarithm of
    the `evidence` for them."""

    fits: tuple[Fit, ...]
    times: Array
    evidence: float

    @property
    def fit(self) -> Fit:
        """Where it ended."""
        return self.fits[-1]


def minimise_by_evidence(
    evaluate: Evaluate, start: Array, group: Group, times: Array | None, least_noise: float = 0.0
) -> Settled:
    """Minimise from offsets `start` (F,) with widths that follow the evidence.

    Without `times` (K,) they begin weak, weighed by a small noise: at a start far off the
    residuals are large, and a prior weighed by these would hold the fit there.
    """
    weak = times is None
    if times is None:
        times = np.full(int(group.kind.max(initial=-1)) + 1, WEAK)
    kappa = FIRST_NOISE**2 if weak else None
    information = group.information(times)
    fits = [minimise(evaluate, start, group.sigma, information, least_noise, kappa)]
    for _ in range(MOST_ROUNDS):
        fit = fits[-1]
        noise = residual_noise(fit.quadratic, group.sigma, least_noise)
        before = times
        times, evidence = widths(fit.quadratic, fit.x, noise, group, before)
        change = np.abs(np.log(times / before)).max(initial=0.0)
        if change < SETTLED and not (weak and len(fits) == 1):
            times = before
            break
        information = group.information(times)
        fits.append(minimise(evaluate, fit.x, group.sigma, information, least_noise))
    return Settled(tuple(fits), times, evidence)
