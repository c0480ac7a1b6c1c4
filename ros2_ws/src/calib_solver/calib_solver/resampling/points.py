# SPDX-License-Identifier: Apache-2.0
"""The same of measured points: a Monte Carlo with drawn noise, and a bootstrap over points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.kinematics import ParameterTable
from calib_model.progress import Progress
from calib_model.transforms import rotation_matrix
from calib_solver.fitting import Quadratic, minimise
from calib_solver.points import (
    Flange,
    PlacedQuadratic,
    Places,
    PointIdentification,
    PointProblem,
)
from calib_solver.resampling.plan import Plan, refuse_repetitions
from calib_solver.resampling.processes import Spread
from calib_solver.resampling.resampling import Kind, Resampled, repeated_of


@dataclass(frozen=True)
class PointSource:
    """What all repetitions of one kind draw from: as `Source`; `places` are those identified,
    `turn_noise` is that of an orientation, rad."""

    problem: PointProblem
    table: ParameterTable
    scale: Array
    width: Array
    information: Array
    identified: Array
    about: Array
    places: Places
    noise: float
    turn_noise: float


def resample_points(
    done: PointIdentification, plan: Plan, spread: Spread, progress: Progress | None = None
) -> Resampled:
    """Carry out a plan by `spread`; deviations (R, F + 3) are of the free parameters and, behind
    them, of the first target's place on the flange.

    Raises:
        DataError: see `refuse_repetitions`.
        CalibrationError: the work could not be spread.
    """
    refuse_repetitions(plan)
    nominal = done.table.nominal[done.table.free_columns]
    found = done.full[done.table.free_columns]
    kinds = (
        Kind('Monte Carlo', monte_carlo_draw, _source(done, _exact(done), found), _about_truth),
        Kind('bootstrap', bootstrap_draw, _source(done, done.problem, nominal), _about_mean),
    )
    return repeated_of(plan, kinds, spread, progress)


def _about_truth(deviation: Array) -> Array:
    covariance: Array = deviation.T @ deviation / len(deviation)
    return covariance


def _about_mean(deviation: Array) -> Array:
    centred = deviation - deviation.mean(axis=0)
    covariance: Array = centred.T @ centred / (len(deviation) - 1)
    return covariance


def _source(done: PointIdentification, problem: PointProblem, about: Array) -> PointSource:
    prior = done.options.prior
    return PointSource(
        problem,
        done.table,
        prior.sigmas(done.table),
        prior.widths(done.table),
        prior.information(done.table),
        done.full[done.table.free_columns],
        about,
        done.places,
        done.uncertainty.noise,
        done.turn_noise or 0.0,
    )


def _exact(done: PointIdentification) -> PointProblem:
    """The points as the identified arm, targets and stations would have them."""
    problem, places = done.problem, done.places
    flange = Flange.of(problem, done.table, done.full)
    base = places.station_rotation[problem.station]
    seen = np.einsum('nij,nj->ni', base, flange.points(problem, places))
    turned = base @ flange.rotation @ places.target_rotation[problem.target]
    return replace(
        problem,
        position=frozen(seen + places.station[problem.station]),
        rotation=frozen(turned),
    )


def monte_carlo_draw(source: PointSource, seed: np.random.SeedSequence) -> tuple[Array, bool]:
    """One repetition with all errors drawn; its deviation (F + 3,) and whether it converged."""
    generator, problem = np.random.default_rng(seed), source.problem
    sigma = source.noise / np.sqrt(problem.weight)
    position = problem.position + sigma[:, None] * generator.standard_normal((len(problem), 3))
    rotation = problem.rotation
    if problem.has_orientation:
        turns = source.turn_noise * generator.standard_normal((len(problem), 3))
        rotation = np.array([rotation_matrix(turn) for turn in turns]) @ rotation
    drawn = replace(problem, position=frozen(position), rotation=frozen(rotation))
    return _refit(source, drawn, generator)


def bootstrap_draw(source: PointSource, seed: np.random.SeedSequence) -> tuple[Array, bool]:
    """One repetition on points drawn with replacement; as `monte_carlo_draw`."""
    generator, count = np.random.default_rng(seed), len(source.problem)
    times = np.bincount(generator.integers(count, size=count), minlength=count)
    return _refit(source, source.problem.trusting(times.astype(float)), generator)


def _refit(
    source: PointSource, problem: PointProblem, generator: np.random.Generator
) -> tuple[Array, bool]:
    """The minimum from the identified parameters, with the prior's mean drawn as it says."""
    known = source.information > 0
    about = source.about + known * source.width * generator.standard_normal(len(source.about))
    objective = PlacedQuadratic(problem, source.table, source.places)

    def evaluate(x: Array) -> Quadratic:
        return objective.at(source.table.full(about + x))

    fit = minimise(evaluate, source.identified - about, source.scale, source.information)
    objective.at(source.table.full(about + fit.x))
    moved = objective.places.target[0] - source.places.target[0]
    return np.concatenate([about + fit.x - source.identified, moved]), fit.converged
