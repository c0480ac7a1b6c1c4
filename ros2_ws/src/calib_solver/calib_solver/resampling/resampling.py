# SPDX-License-Identifier: Apache-2.0
"""Uncertainties by doing it again: a Monte Carlo, and a bootstrap over whole gauge locations.

Both check the covariance that `uncertainty` states. The Monte Carlo takes the identified arm for
the true one and draws noise for the poses, errors for the certificate and nominal values about
the truth, each as large as they are held to be. The bootstrap draws the gauge's locations with
replacement, so it asks the poses themselves how much they scatter, whatever the model leaves out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Gauge
from calib_model.kinematics import CorrectedArm, ParameterTable
from calib_model.measurement import Measurement
from calib_model.progress import Progress
from calib_solver.fitting import minimise, objective
from calib_solver.identified import Identification
from calib_solver.problem import Problem, accumulate, place_gauge, take_groups
from calib_solver.quality import probed_points
from calib_solver.resampling.plan import Plan, refuse_plan

if TYPE_CHECKING:
    from calib_solver.resampling.processes import Spread


@dataclass(frozen=True)
class Source:
    """What all repetitions of one kind draw from.

    `identified` (F,) are the free parameters as found and `about` (F,) the values that a drawn
    prior's mean lies about by its `width` (F,), all m and rad; `noise` (m) is that of a pose's
    coordinate, and `least_noise` (m^2) as in `levenberg.minimise`.
    """

    problem: Problem
    table: ParameterTable
    objective: str
    scale: Array
    width: Array
    information: Array
    identified: Array
    about: Array
    noise: float
    least_noise: float


@dataclass(frozen=True)
class Repeated:
    """R repetitions: `deviation` (R, F) of the free parameters (m, rad) from `Source.identified`,
    how many `converged`, and the `covariance` (F, F) that they show."""

    deviation: Array
    converged: int
    covariance: Array
    seconds: float

    @property
    def standard(self) -> Array:
        """Standard uncertainty of each free parameter, shape (F,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class Resampled:
    """What was asked for of a `plan`; None for what was not."""

    plan: Plan
    monte_carlo: Repeated | None
    bootstrap: Repeated | None


@dataclass(frozen=True)
class Kind:
    """A kind of repetition: its `name`, how one is drawn from the `source`, and the covariance that
    deviations (R, F) show."""

    name: str
    draw: Callable[[Any, np.random.SeedSequence], tuple[Array, bool]]
    source: object
    covariance: Callable[[Array], Array]


def resample(
    done: Identification, plan: Plan, spread: Spread, progress: Progress | None = None
) -> Resampled:
    """Carry out a plan by `spread`; the outcome does not depend on how the work is spread.

    Raises:
        DataError: see `refuse_plan`.
        CalibrationError: the work could not be spread.
    """
    locations = len(done.problem.locations)
    refuse_plan(plan, locations, done.problem.measured.source)
    kinds = (
        Kind(
            'Monte Carlo',
            monte_carlo_draw,
            monte_carlo_source(done) if plan.monte_carlo else None,
            lambda deviation: deviation.T @ deviation / len(deviation),  # about the truth
        ),
        Kind(
            'bootstrap',
            bootstrap_draw,
            bootstrap_source(done) if plan.bootstrap else None,
            lambda deviation: bootstrap_covariance(deviation, locations),
        ),
    )
    return repeated_of(plan, kinds, spread, progress)


def repeated_of(
    plan: Plan, kinds: tuple[Kind, Kind], spread: Spread, progress: Progress | None
) -> Resampled:
    """Both kinds, Monte Carlo and bootstrap, as often as a plan says.

    Raises:
        CalibrationError: the work could not be spread.
    """
    seeds = np.random.SeedSequence(plan.seed).spawn(2)
    found: list[Repeated | None] = []
    for kind, count, seed in zip(kinds, (plan.monte_carlo, plan.bootstrap), seeds, strict=True):
        if not count:
            found.append(None)
            continue
        begun = time.perf_counter()
        shown = _Shown(progress, kind.name, count)
        runs = spread(kind.draw, kind.source, seed.spawn(count), shown.advance)
        shown.clear()
        deviation = np.stack([run[0] for run in runs])
        converged = sum(run[1] for run in runs)
        covariance = kind.covariance(deviation)
        found.append(Repeated(deviation, converged, covariance, time.perf_counter() - begun))
    return Resampled(plan, found[0], found[1])


def bootstrap_covariance(deviation: Array, locations: int) -> Array:
    """Covariance (F, F) of the repetitions about their mean; drawing with replacement from L
    locations shows only (L - 1) / L of it, which is made up for."""
    centred = deviation - deviation.mean(axis=0)
    covariance: Array = centred.T @ centred / (len(deviation) - 1)
    return covariance * locations / (locations - 1)


def bootstrap_source(done: Identification) -> Source:
    """The poses as they are."""
    return _source(done, done.problem, done.table.nominal[done.table.free_columns])


def monte_carlo_source(done: Identification) -> Source:
    """The poses as the identified arm would have taken them, without noise, on a gauge that is
    as certified and lies as well as it can where it was found."""
    exact = replace(done.problem, centers=frozen(exact_centers(done)))
    return _source(done, exact, done.full[done.table.free_columns])


def _source(done: Identification, problem: Problem, about: Array) -> Source:
    measured = problem.measured
    # the poses as they came are a second copy: no repetition looks at them
    none = measured.poses.take(np.zeros(0, dtype=np.int64))
    prior = done.options.prior
    uncertainty = done.uncertainty
    return Source(
        replace(problem, measured=replace(measured, poses=none)),
        done.table,
        done.options.objective,
        prior.sigmas(done.table),
        prior.widths(done.table),
        prior.information(done.table),
        done.full[done.table.free_columns],
        about,
        uncertainty.noise * float(np.sqrt(uncertainty.misfit)),
        done.least_noise,
    )


def exact_centers(done: Identification) -> Array:
    """Where the sphere would sit in the probe (N, 3), m, if every pose hit it exactly."""
    problem, spheres = done.problem, done.identified.spheres
    gauge = problem.measured.gauge
    certified = np.array([gauge.center(int(number)) for number in problem.keys[:, 1]])
    target = np.empty_like(spheres.center)
    for rows in problem.placements:
        weight = problem.counts[rows].astype(float)
        target[rows] = place_gauge(certified[rows], spheres.center[rows], weight).points
    points = probed_points(problem, done.arm, done.probe, done.model)
    miss = np.repeat(target, problem.counts, axis=0) - points
    arm = CorrectedArm(done.arm, done.model)
    turned = arm.forward(problem.joints)[:, :3, :3] @ done.probe.flange_T_probe.rotation
    centers: Array = problem.centers + np.einsum('nij,ni->nj', turned, miss)
    return centers


def monte_carlo_draw(source: Source, seed: np.random.SeedSequence) -> tuple[Array, bool]:
    """One repetition with all errors drawn; its deviation (F,) and whether it converged."""
    generator = np.random.default_rng(seed)
    problem = source.problem
    # noise alike in all directions is that in any frame, so it may as well be the probe's
    noise = source.noise * generator.standard_normal(problem.centers.shape)
    measured = with_gauge(problem.measured, drawn_gauge(problem.measured.gauge, generator))
    problem = replace(
        problem,
        centers=frozen(problem.centers + noise),
        measured=measured,
        nominal=frozen(certified_distances(problem, measured.gauge)),
    )
    return _refit(source, problem, generator)


def bootstrap_draw(source: Source, seed: np.random.SeedSequence) -> tuple[Array, bool]:
    """One repetition on locations drawn with replacement; as `monte_carlo_draw`."""
    generator = np.random.default_rng(seed)
    locations = source.problem.locations
    drawn = generator.integers(len(locations), size=len(locations))
    problem = take_groups(source.problem, [locations[i] for i in np.sort(drawn)])
    return _refit(source, problem, generator)


def drawn_gauge(gauge: Gauge, generator: np.random.Generator) -> Gauge:
    """A certificate with errors as its uncertainty (at k = 2) has them: one scale for all, and
    for each sphere an error of its own that every distance to it shares."""
    scale = 1 + gauge.proportional / 2 * generator.standard_normal()
    size = gauge.constant / 2 / np.sqrt(2)
    spheres = []
    for number, center in gauge.spheres:
        x, y, z = scale * np.array(center) + size * generator.standard_normal(3)
        spheres.append((number, (float(x), float(y), float(z))))
    return replace(gauge, spheres=tuple(spheres))


def with_gauge(measured: Measurement, gauge: Gauge) -> Measurement:
    """The measurement with another certificate."""
    return replace(measured, gauge=gauge)


def certified_distances(problem: Problem, gauge: Gauge) -> Array:
    """A certificate's distance (M,) for every pair of the problem, m."""
    certified = {number: gauge.center(number) for number in gauge.numbers}
    numbers = problem.keys[:, 1][problem.pairs]
    between = [certified[int(j)] - certified[int(k)] for j, k in numbers]
    distances: Array = np.linalg.norm(np.reshape(between, (-1, 3)), axis=1)
    return distances


def _refit(source: Source, problem: Problem, generator: np.random.Generator) -> tuple[Array, bool]:
    """The minimum from the identified parameters, with the prior's mean drawn as it says."""
    known = source.information > 0
    about = source.about + known * source.width * generator.standard_normal(len(source.about))
    cost = objective(source.objective)

    def evaluate(x: Array) -> Any:
        return cost(problem, accumulate(problem, source.table, source.table.full(about + x)))

    fit = minimise(
        evaluate,
        source.identified - about,
        source.scale,
        source.information,
        source.least_noise,
    )
    return about + fit.x - source.identified, fit.converged


class _Shown:
    """How far one kind of repetition has come."""

    def __init__(self, progress: Progress | None, name: str, planned: int) -> None:
        self._progress = progress
        self._name = name
        self._planned = planned
        self._done = 0
        self._first = 0.0

    def advance(self) -> None:
        """One more is done."""
        self._done += 1
        if self._progress is None:
            return
        now = time.monotonic()
        if self._done == 1:
            # from here on: the workers' own start says nothing of how long a repetition takes
            self._first = now
        since = self._done - 1
        left = (now - self._first) / since * (self._planned - self._done) if since else math.inf
        self._progress.show(self._done, self._planned, left, self._name, now)

    def clear(self) -> None:
        """Take the bar away."""
        if self._progress is not None:
            self._progress.clear()
