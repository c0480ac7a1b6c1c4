# SPDX-License-Identifier: Apache-2.0
"""How wide the prior is by the data themselves: MacKay's evidence, for each kind of parameter.

D. J. C. MacKay, Bayesian interpolation, Neural Computation 4 (1992) 415-447: where the data tell a
parameter (gamma near 1) its offset says how wide its kind is, where they do not it says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import JOINT_PARAMETERS
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
#: m or rad, nor do they begin wider than that unless that is usual
WIDEST_BEGIN = 0.05
#: m, what a residual is held to be until a first minimum shows it: little, so that a start far off
#: is no reason to stay there
FIRST_NOISE = 1e-4
#: m, below which a residual says nothing more of the widths
LEAST_NOISE = 1e-8
#: the residuals' mean square still falls when it falls to this part
LOWER = 0.25
#: with fewer terms than so many for each parameter, or residuals larger than this (m), a minimum
#: may be another than the one that the data are for
FEW, APART = 1.5, 3e-4
#: m, a residual is held to be no less where there are few
FEW_NOISE = 1e-7
#: m, the same of a guide's: arm, probe and gauge do not repeat better than that
GUIDE_NOISE = 3e-6
#: m, what one is held to be from where a guide led: next to nothing, as the prior has been heard
LED_NOISE = 1e-9
#: so many offsets of each kind count as seen beforehand
BEFOREHAND = 2.0
#: widths are settled when none changes by more than this part
SETTLED = 0.02
MOST_ROUNDS = 6
MOST_UPDATES = 50
#: no width is narrower than this part of what is usual, none wider than this, m or rad: a probe's
#: mount is known that well, a joint's zero too
NARROWEST, WIDEST = 1e-3, 0.5
#: kinds of parameters that are the same after a whole turn
ANGLES = ('alpha', 'theta_0', 'beta')

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Group:
    """Free parameters that have a width in common: `sigma` (F,) is what each usually is off by (m,
    rad), `kind` (F,) the number of its kind, from 0, `turns` (F,) which are angles of D-H, `rows`
    (K,) which kinds are those of a D-H row."""

    sigma: Array
    kind: IntArray
    turns: Mask
    rows: Mask

    def minimised(
        self,
        evaluate: Evaluate,
        start: Array,
        information: Array,
        least_noise: float,
        kappa: float | None = None,
        scale: Array | None = None,
        rough: bool = False,
    ) -> Fit:
        """As `minimise`, in steps of `scale` (F,) or `sigma`, its angles within half a turn of
        nominal."""
        steps = self.sigma if scale is None else scale
        fit = minimise(evaluate, start, steps, information, least_noise, kappa, rough)
        turned = np.where(self.turns, np.round(fit.x / (2 * np.pi)), 0.0)
        return replace(fit, x=fit.x - 2 * np.pi * turned) if turned.any() else fit

    def weak(self) -> Array:
        """The times (K,) to begin with: WEAK, and no wider than a mount, which is known least."""
        return np.minimum(WEAK, np.maximum(WIDEST_BEGIN / self._size(), 1.0))

    def widest(self) -> Array:
        """The most times (K,) a kind can be wide."""
        return WIDEST / self._size()

    def beforehand(self, times: Array, told: Array) -> Array:
        """How many times (K,) as large as usual an offset is before it is told, 1 or more, by the
        `times` (K,) of all kinds and how far each is `told` (K,) in all.

        The kinds of a D-H row go together, by the mean of their logarithms: an arm whose zeros are
        far off is seldom one whose links are as drawn. One more counts as usual.
        """
        weight = np.where(self.rows, told, 0.0)
        mean = float(weight @ np.log(times)) / (float(weight.sum()) + 1.0)
        return np.where(self.rows, np.exp(max(mean, 0.0)), 1.0)

    def _size(self) -> Array:
        size = np.zeros(int(self.kind.max(initial=-1)) + 1)
        size[self.kind] = self.sigma
        return size

    def information(self, times: Array) -> Array:
        """1 / (times sigma)^2 of every parameter (F,), by the `times` (K,) of the kinds."""
        information: Array = 1 / (times[self.kind] * self.sigma) ** 2
        return information


def groups(table: ParameterTable, sigma: Array) -> tuple[tuple[str, ...], Group]:
    """The kinds (K,) of a table's free parameters, by kind; `sigma` (F,) is `Group`'s."""
    kinds = tuple(dict.fromkeys(parameter.kind for parameter in table.free))
    kind = [kinds.index(parameter.kind) for parameter in table.free]
    turns = [parameter.kind in ANGLES for parameter in table.free]
    rows = [one in JOINT_PARAMETERS for one in kinds]
    return kinds, Group(
        sigma,
        np.array(kind, dtype=np.int64),
        np.array(turns, dtype=bool),
        np.array(rows, dtype=bool),
    )


@dataclass(frozen=True)
class Widths:
    """`times` (K,) what is usual, a residual's mean square `noise` (m^2), the logarithm of the
    `evidence` for both, and how far the data tell each parameter, `told` (F,), 0 to 1."""

    times: Array
    noise: float
    evidence: float
    told: Array


def widths(
    quadratic: Quadratic, x: Array, noise: float, group: Group, times: Array, few: bool = False
) -> Widths:
    """By how many times the parameters of each kind are off what is usual.

    The objective is taken as `quadratic` about offsets `x` (F,), `noise` (m^2) is a residual's mean
    square; begun from `times` (K,). Some offsets count as seen BEFOREHAND of each kind, so that one
    which nothing tells is as usual, or as the others are. Where residuals are `few` they do not
    tell the noise before it is known how many the parameters take up: both are found together.
    """
    sigma, kind, count = group.sigma, group.kind, len(times)
    normal = sigma[:, None] * quadratic.normal * sigma
    gradient, at = sigma * quadratic.gradient, x / sigma
    for _ in range(MOST_UPDATES):
        held = times[kind]
        root = held[:, None] * normal * held / noise + np.eye(len(x))
        # what nothing tells may be so far out of scale that rounding takes the 1 of its width
        inverse = np.linalg.pinv(root, hermitian=True)
        left = -held * (inverse @ (held * gradient / noise + at / held))
        offset = at + left
        told: Array = np.clip(1 - np.diag(inverse), 0.0, 1.0)
        phi = max(quadratic.phi + float(left @ (2 * gradient + normal @ left)), 0.0)
        before, noise_before = times, noise
        of_kind: Array = np.bincount(kind, told, count).astype(np.float64)
        usual = group.beforehand(times, of_kind)
        square = np.bincount(kind, offset**2, count) + BEFOREHAND * usual**2
        times = np.sqrt(square / (of_kind + BEFOREHAND))
        times = np.clip(times, NARROWEST, group.widest())
        if few:
            noise = max(phi / max(quadratic.terms - float(told.sum()), 1.0), FEW_NOISE**2)
        change = np.abs(np.log(times / before)).max(initial=abs(np.log(noise / noise_before)))
        if change < SETTLED / 2:
            break
    evidence = phi / noise_before + float((offset / held) @ (offset / held))
    evidence += float(np.linalg.slogdet(root)[1]) + quadratic.terms * float(np.log(noise_before))
    return Widths(times, noise, -0.5 * evidence, told)


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
    evaluate: Evaluate,
    start: Array,
    group: Group,
    times: Array | None,
    least_noise: float = 0.0,
    guide: Evaluate | None = None,
) -> Settled:
    """Minimise from offsets `start` (F,) with widths that follow the evidence.

    Without `times` (K,) they begin weak, weighed by a small noise: at a start far off the
    residuals are large, and a prior weighed by these would hold the fit there. Where that leaves
    doubts, other ways are tried from the same start, and the one the evidence is for is taken.

    A `guide` leads, if there is one, an objective that tells more by the same few poses: it gives
    the widths and the place from which hardly any prior is left. Distances along a straight bar go
    with the square of a sphere's offset across it: a long, bent valley, and the prior would go
    down its floor.
    """
    if guide is not None:
        return _led(evaluate, guide, start, group, times, least_noise)
    first = _begun(evaluate, start, group, times, least_noise)
    if times is not None or not _doubtful(first):
        return first
    found = [first]
    for way in (first.times, np.ones(len(first.times)), None):
        held = _other(evaluate, start, group, way, least_noise)
        found.append(
            _tightened(evaluate, held, group, first.times if way is None else way, least_noise)
        )
    best = max(found, key=lambda one: one.evidence)
    every = tuple(fit for one in found if one is not best for fit in one.fits)
    return Settled((*every, *best.fits), best.times, best.evidence)


def _begun(
    evaluate: Evaluate, start: Array, group: Group, times: Array | None, least_noise: float
) -> Settled:
    """Widths and minimum, from `times` (K,) that were found before or from weak ones."""
    held: tuple[Fit, ...]
    if times is None:
        times = group.weak()
        held = _weakly_held(evaluate, start, group, times, least_noise)
    else:
        information = group.information(times)
        held = (group.minimised(evaluate, start, information, least_noise, rough=True),)
    return _tightened(evaluate, held, group, times, least_noise)


def _led(
    evaluate: Evaluate,
    guide: Evaluate,
    start: Array,
    group: Group,
    times: Array | None,
    least_noise: float,
) -> Settled:
    """The minimum next to that of a guide, which is in doubt where the guide's is."""
    led = _begun(guide, start, group, times, max(least_noise, GUIDE_NOISE**2))
    information = group.information(led.times)
    fit = group.minimised(evaluate, led.fit.x, information, least_noise, LED_NOISE**2)
    if not led.fit.converged:
        fit = replace(fit, converged=False, reason=led.fit.reason)
    elif fit.unseen.shape[1]:
        alone = f'{fit.unseen.shape[1]} directions are told by the certificate alone (eq. 10)'
        fit = replace(fit, reason=f'{alone}, not by distances and scatter')
    # what the guide came down is not the objective
    on_the_way = tuple(replace(one, history=()) for one in led.fits)
    return replace(led, fits=(*on_the_way, fit))


def _doubtful(settled: Settled) -> bool:
    """Whether a minimum may be another than the one that the data are for."""
    fit = settled.fit
    stopped = not all(one.converged for one in settled.fits)
    return stopped or fit.quadratic.terms < FEW * len(fit.x) or fit.kappa > APART**2


def _other(
    evaluate: Evaluate, start: Array, group: Group, times: Array | None, least_noise: float
) -> tuple[Fit, ...]:
    """From the start with widths already known, or without any prior."""
    if times is None:
        return (group.minimised(evaluate, start, np.zeros(len(start)), least_noise),)
    information = group.information(times)
    kappa = None if (times == 1).all() else FIRST_NOISE**2
    return (group.minimised(evaluate, start, information, least_noise, kappa),)


def _tightened(
    evaluate: Evaluate, fits: tuple[Fit, ...], group: Group, times: Array, least_noise: float
) -> Settled:
    """Widths and minimum in turn, until the widths settle."""
    few = fits[-1].quadratic.terms < FEW * len(group.sigma)
    for number in range(MOST_ROUNDS):
        fit = fits[-1]
        noise = residual_noise(fit.quadratic, group.sigma, max(least_noise, LEAST_NOISE**2))
        found = widths(fit.quadratic, fit.x, noise, group, times, few)
        change = np.abs(np.log(found.times / times)).max(initial=0.0)
        if change < SETTLED and number:
            break
        times = found.times
        information = group.information(times)
        kappa = max(found.noise, least_noise) if few else None
        fits += (group.minimised(evaluate, fit.x, information, least_noise, kappa),)
    return Settled(fits, times, found.evidence)


def _weakly_held(
    evaluate: Evaluate, start: Array, group: Group, times: Array, least_noise: float
) -> tuple[Fit, ...]:
    """Minima with a prior that is weighed by less and less, as long as the residuals fall with
    it; the last one is where the tightening begins."""
    information = group.information(times)
    scale = times[group.kind] * group.sigma
    fits: tuple[Fit, ...] = ()
    left, kappa = np.inf, FIRST_NOISE**2
    for _ in range(MOST_ROUNDS):
        fit = group.minimised(evaluate, start, information, least_noise, kappa, scale, rough=True)
        noise = residual_noise(fit.quadratic, group.sigma, least_noise)
        if noise > LOWER * left:
            break
        fits += (fit,)
        start, left, kappa = fit.x, noise, noise / 100
        if noise < LEAST_NOISE**2:
            break
    return fits
