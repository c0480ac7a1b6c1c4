# SPDX-License-Identifier: Apache-2.0
"""How sure the identified parameters are: from the poses' noise, the certificate and the misfit.

The objective is not a likelihood (eq. 11 weighs what the chapter weighs), so the covariance is
that of its minimiser: H^-1 C H^-1 with H the J'J of the cost and C the covariance of its
gradient, which is a sum over spheres of known shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Gauge
from calib_solver.fitting.objectives import (
    Quadratic,
    apart,
    distance_errors,
    fit_placement,
    repeatability_weights,
)
from calib_solver.fitting.pose_noise import ROUNDING, full_inverse, noise_variance
from calib_solver.problem import IntArray, Problem, SphereSums

#: the data hold a direction by themselves where their weight is so many times the prior's
BY_FAR = 100.0
#: m or rad, of what neither poses nor a prior tell
UNKNOWN = 1.0


@dataclass(frozen=True)
class Uncertainty:
    """`covariance` (F, F) of the free parameters (m, rad), and what went into it.

    `noise` is the standard deviation of a single probing pose per coordinate, m; `misfit` the
    factor (1 or more) by which the locations scatter more than that noise explains. The noise is
    `assumed` where the poses are too few to tell it.
    """

    covariance: Array
    noise: float
    misfit: float
    assumed: bool = False

    @property
    def standard(self) -> Array:
        """Standard uncertainty of each free parameter, shape (F,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


@dataclass(frozen=True)
class GradientNoise:
    """What makes the gradient of an objective random, per unit of what is random.

    `by_pose` (S, F, F): covariance of each sphere's share under unit variance of every pose's
    coordinates; `by_certificate` (F, F): that of the gauge's certificate, m^2 included.
    """

    by_pose: Array
    by_certificate: Array


def estimate_uncertainty(
    problem: Problem,
    name: str,
    sums: SphereSums,
    quadratic: Quadratic,
    kappa: float,
    information: Array,
    strength: float,
    wider: Array | float = 1.0,
) -> Uncertainty:
    """The covariance at the minimum of objective `name`.

    `information` (F,) is strength / sigma^2 of the prior, `kappa` its weight in the cost;
    the parameters may be off `wider` (F,) times as far as it says.
    """
    noise, assumed = noise_variance(problem, name, sums, quadratic)
    parts = gradient_noise(problem, name, sums)
    prior = kappa * information
    held = directions_held(quadratic.normal, prior)
    misfit = misfit_factor(problem, name, sums, noise, parts, held)
    hessian = quadratic.normal + np.diag(prior)
    scatter = noise * misfit * parts.by_pose.sum(axis=0) + parts.by_certificate
    # the truth lies about nominal as the prior says: its pull is an error of that size
    pull = kappa**2 * information * strength * wider**2
    covariance = covariance_of(scatter + np.diag(pull), hessian, information, strength * wider**2)
    return Uncertainty(covariance, float(np.sqrt(noise)), misfit, assumed)


def covariance_of(
    scatter: Array, hessian: Array, information: Array, strength: Array | float
) -> Array:
    """The covariance (F, F) at a minimum whose gradient has the covariance `scatter` (F, F).

    `hessian` (F, F) is J'J with the prior's share; what neither tells is as sure as the prior's
    `information` (F,), strength / sigma^2, says, or known to 1 m and 1 rad without one.
    """
    inverse, untold = _told_and_untold(hessian, information, strength)
    # by way of a square root of the scatter, so that rounding leaves no negative variance
    squares, axes = np.linalg.eigh(scatter)
    root = inverse @ (axes * np.sqrt(np.maximum(squares, 0.0)))
    covariance: Array = root @ root.T + untold
    return covariance


def _told_and_untold(
    hessian: Array, information: Array, strength: Array | float
) -> tuple[Array, Array]:
    """The inverse (F, F) along what was held in the fit, and the covariance (F, F) of the rest: the
    prior's own, which had no weight where nothing was left over, or `UNKNOWN` without one."""
    sigma = prior_width(information, strength)
    values, vectors = np.linalg.eigh(sigma[:, None] * hessian * sigma)
    held = values > ROUNDING * values.max(initial=1e-300)
    if held.all():
        return full_inverse(hessian)[0], np.zeros_like(hessian)
    axes = sigma[:, None] * vectors
    inverse = (axes[:, held] / values[held]) @ axes[:, held].T
    return inverse, axes[:, ~held] @ axes[:, ~held].T


def prior_width(information: Array, strength: Array | float) -> Array:
    """How far the parameters (F,) may be from nominal, m or rad: `UNKNOWN` without a prior."""
    width = np.full(len(information), UNKNOWN)
    known = information > 0
    width[known] = np.sqrt((strength * np.ones(len(width)))[known] / information[known])
    return width


@dataclass(frozen=True)
class GradientSlopes:
    """How the gradient of an objective goes with what is random: `weight` (S,) times a pose's
    centred Jacobian with the pose itself, `leverage` (S, 3, F) with a sphere's mean, `by_center`
    (3K, F) with the coordinates of the gauge's K spheres."""

    weight: Array
    leverage: Array
    by_center: Array


def gradient_slopes(problem: Problem, name: str, sums: SphereSums) -> GradientSlopes:
    """The slopes for an objective, sphere by sphere."""
    spheres, free = sums.gradient.shape
    weight: Array = np.zeros(spheres)
    leverage: Array = np.zeros((spheres, 3, free))
    by_center: Array = np.zeros((3 * len(problem.measured.gauge.spheres), free))
    if name in ('distance_repeatability', 'position'):
        weight = weight + (repeatability_weights(sums) if name != 'position' else 1.0)
    if name in ('distance_repeatability', 'distance'):
        leverage, by_center = _distance_leverage(problem, sums)
    if name == 'position':
        leverage, by_center = _position_leverage(problem, sums)
    return GradientSlopes(weight, leverage, by_center)


def gradient_noise(problem: Problem, name: str, sums: SphereSums) -> GradientNoise:
    """The gradient's covariance for an objective, sphere by sphere."""
    slopes = gradient_slopes(problem, name, sums)
    by_pose = slopes.weight[:, None, None] ** 2 * sums.normal + np.einsum(
        'skf,skg,s->sfg', slopes.leverage, slopes.leverage, 1 / np.maximum(sums.count, 1)
    )
    certificate = certificate_covariance(problem.measured.gauge)
    return GradientNoise(by_pose, slopes.by_center.T @ certificate @ slopes.by_center)


def _distance_leverage(problem: Problem, sums: SphereSums) -> tuple[Array, Array]:
    """How the gradient's distance part moves with each sphere's mean, shape (S, 3, F), and with
    the coordinates of the gauge's K spheres, shape (3K, F)."""
    _, slope = distance_errors(problem, sums)
    first, second = problem.pairs.T
    _, unit = apart(sums.center, problem.pairs)
    weighted = unit[:, :, None] * slope[:, None, :]
    leverage = np.zeros((len(problem.keys), 3, slope.shape[1]))
    np.add.at(leverage, first, weighted)
    np.add.at(leverage, second, -weighted)
    certified, place = _certified(problem)
    _, unit = apart(certified, place[problem.pairs])
    weighted = unit[:, :, None] * slope[:, None, :]
    by_center = np.zeros((len(certified), 3, slope.shape[1]))
    np.add.at(by_center, place[first], -weighted)
    np.add.at(by_center, place[second], weighted)
    return leverage, by_center.reshape(3 * len(certified), slope.shape[1])


def _position_leverage(problem: Problem, sums: SphereSums) -> tuple[Array, Array]:
    """The same for eq. 10, whose placements take up part of what the means and the gauge do."""
    free = sums.gradient.shape[1]
    certified, place = _certified(problem)
    leverage = np.zeros((len(problem.keys), 3, free))
    by_center = np.zeros((len(certified), 3, free))
    for rows in problem.placements:
        fitted = fit_placement(problem, sums, rows)
        root = np.sqrt(sums.count[rows])
        own = root[:, None, None] * fitted.slope.reshape(len(rows), 3, free)
        leverage[rows] = own
        np.add.at(by_center, place[rows], -np.einsum('ki,skf->sif', fitted.rotation, own))
    return leverage, by_center.reshape(3 * len(certified), free)


def _certified(problem: Problem) -> tuple[Array, IntArray]:
    """The certificate's centres (K, 3), m, and which of them each probed sphere is (S,)."""
    gauge = problem.measured.gauge
    places = [gauge.numbers.index(int(number)) for number in problem.keys[:, 1]]
    return np.array([center for _, center in gauge.spheres]), np.array(places, dtype=np.int64)


def certified_root(problem: Problem) -> Array:
    """A root R (D, 3K), m, of the covariance R R' of a problem's certified distances: by the
    certificate a sphere is off by the same in all its distances and at every location."""
    certified, place = _certified(problem)
    pairs = place[problem.pairs]
    _, unit = apart(certified, pairs)
    by_center = np.zeros((len(pairs), len(certified), 3))
    each = np.arange(len(pairs))
    by_center[each, pairs[:, 0]], by_center[each, pairs[:, 1]] = -unit, unit
    values, vectors = np.linalg.eigh(certificate_covariance(problem.measured.gauge))
    root: Array = by_center.reshape(len(pairs), 3 * len(certified)) @ (
        vectors * np.sqrt(np.maximum(values, 0.0))
    )
    return root


def certificate_covariance(gauge: Gauge) -> Array:
    """Covariance (3K, 3K) of the coordinates of the gauge's spheres, m^2.

    The certificate's expanded uncertainty of a distance is taken at k = 2. Its constant part is
    shared between the two spheres, each off by itself but the same at whatever location; its
    proportional part is one scale for the whole gauge.
    """
    certified = np.array([center for _, center in gauge.spheres])
    along = (certified - certified.mean(axis=0)).reshape(-1)
    constant = (gauge.constant / 2) ** 2 / 2 * np.eye(len(along))
    covariance: Array = constant + (gauge.proportional / 2) ** 2 * np.outer(along, along)
    return covariance


def directions_held(normal: Array, prior: Array) -> Array:
    """Directions (F, K) in which the data outweigh the prior's part (F,) of the cost by far."""
    if not (prior > 0).all():
        return np.eye(len(prior))
    scale = 1 / np.sqrt(prior)
    values, vectors = np.linalg.eigh(scale[:, None] * normal * scale)
    held: Array = scale[:, None] * vectors[:, values > BY_FAR]
    return held


def misfit_factor(
    problem: Problem,
    name: str,
    sums: SphereSums,
    noise: float,
    parts: GradientNoise,
    held: Array,
) -> float:
    """How much more the locations' gradients scatter than independent pose noise explains.

    At the minimum the locations' shares of the gradient cancel; with noise alone each scatters
    with its own covariance. The factor is the mean of g' C^-1 g over what it should be, taken as
    1 when it is not significantly more: the model then says all there is to say. Only along the
    directions `held` (F, K) by the data: elsewhere it is the prior that pulls the shares apart.
    """
    clusters = problem.locations
    if len(clusters) < 2:
        clusters = [np.array([s]) for s in range(len(problem.keys))]
    if len(clusters) < 2 or noise <= 0 or held.shape[1] == 0:
        return 1.0
    shares = _gradient_shares(problem, name, sums) @ held
    total = held.T @ (noise * parts.by_pose.sum(axis=0) + parts.by_certificate) @ held
    values, vectors = np.linalg.eigh(total)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    whitened = shares @ vectors[:, kept] / np.sqrt(values[kept])
    gathered = np.array([whitened[rows].sum(axis=0) for rows in clusters])
    gathered = gathered - gathered.mean(axis=0)
    freedom = int(kept.sum()) * (len(clusters) - 1)
    factor = float((gathered**2).sum()) * len(clusters) / freedom
    significant = 1 + 3 * np.sqrt(2 / freedom)
    return factor if factor > significant else 1.0


def _gradient_shares(problem: Problem, name: str, sums: SphereSums) -> Array:
    """Each sphere's share of J'r at the minimum, shape (S, F); a distance counts half for each."""
    shares = np.zeros_like(sums.gradient)
    if name == 'distance_repeatability':
        shares += repeatability_weights(sums)[:, None] * sums.gradient
    if name == 'position':
        shares += sums.gradient
        for rows in problem.placements:
            fitted = fit_placement(problem, sums, rows)
            by_sphere = fitted.slope.reshape(len(rows), 3, -1)
            residual = fitted.residual.reshape(-1, 3)
            shares[rows] += np.einsum('skf,sk->sf', by_sphere, residual)
    if name in ('distance_repeatability', 'distance'):
        error, slope = distance_errors(problem, sums)
        half = 0.5 * error[:, None] * slope
        np.add.at(shares, problem.pairs[:, 0], half)
        np.add.at(shares, problem.pairs[:, 1], half)
    return shares
