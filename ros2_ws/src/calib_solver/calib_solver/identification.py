# SPDX-License-Identifier: Apache-2.0
"""The identification: from a measurement to corrected parameters that account for themselves."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from calib_model.arm import Arm
from calib_model.errors import DataError, RankError
from calib_model.parameters import ParameterTable
from calib_model.probe import PassiveProbe, Probe
from calib_model.probing import Measurement
from calib_model.rotation import Array
from calib_solver.freedom import identifiable_table
from calib_solver.levenberg import Fit, minimise
from calib_solver.objectives import Objective, Quadratic, objective
from calib_solver.observability import Observability, observe
from calib_solver.prior import DEFAULT_PRIOR, Prior
from calib_solver.probe_fit import ProbeFit, fit_probe
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess
from calib_solver.sums import accumulate


@dataclass(frozen=True)
class Options:
    """What a user can choose: the objective, parameters to fix or free by pattern, the prior."""

    objective: str = 'distance_repeatability'
    fix: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    prior: Prior = DEFAULT_PRIOR


@dataclass(frozen=True)
class Identification:
    """A solved calibration: parameters before and after, their fit, and the quality of both."""

    problem: Problem
    options: Options
    table: ParameterTable
    full: Array
    arm: Arm
    probe: Probe
    fit: Fit
    observability: Observability
    probe_fit: ProbeFit | None
    initial: Quality
    identified: Quality
    seconds: float
    warnings: tuple[str, ...] = field(default=())


def identify(measured: Measurement, options: Options | None = None) -> Identification:
    """Eq. 11 (or the chosen objective) minimised from the nominal parameters.

    Raises:
        DataError: the poses do not fit the descriptions, or there are not enough of them.
        RankError: nothing can be told from these poses, or the fit is worse than its start.
    """
    begun = time.perf_counter()
    options = options or Options()
    problem = Problem.of(measured)
    table = identifiable_table(measured.arm, measured.probe, options.fix, options.free)
    chosen = objective(options.objective)
    _refuse_too_little(problem, chosen, table, options)
    evaluator = _Evaluator(problem, table, chosen)
    probe_fit, warnings = _try_probe_fit(problem)
    start = _start(evaluator, table, probe_fit)
    fit = minimise(evaluator, start, options.prior.sigmas(table), options.prior.information(table))
    full = table.full(table.nominal[table.free_columns] + fit.x)
    arm, probe = table.apply(full, measured.arm, measured.probe)
    seconds = time.perf_counter() - begun
    return Identification(
        problem, options, table, full, arm, probe, fit,
        observe(table, fit, options.prior), probe_fit,
        assess(problem, measured.arm, measured.probe), assess(problem, arm, probe),
        seconds, tuple(warnings),
    )  # fmt: skip


class _Evaluator:
    """The objective as a function of the free parameters' offsets from nominal."""

    def __init__(self, problem: Problem, table: ParameterTable, chosen: Objective) -> None:
        self.problem = problem
        self.table = table
        self.objective = chosen
        self.nominal = table.nominal[table.free_columns]

    def __call__(self, x: Array) -> Quadratic:
        sums = accumulate(self.problem, self.table, self.table.full(self.nominal + x))
        return self.objective(self.problem, sums)


def _refuse_too_little(
    problem: Problem, chosen: Objective, table: ParameterTable, options: Options
) -> None:
    sums = accumulate(problem, table, table.nominal)
    quadratic = chosen(problem, sums)
    if quadratic.terms == 0:
        raise DataError(
            f'{problem.measured.source}: objective {options.objective} has no terms here: '
            'needs two spheres in one location or several poses of one sphere'
        )
    if options.prior.strength == 0 and quadratic.terms < len(table.free_columns):
        raise RankError(
            f'{problem.measured.source}: {int(quadratic.terms)} residuals cannot tell '
            f'{len(table.free_columns)} parameters without a prior'
        )
    if not np.isfinite(quadratic.phi):
        raise DataError(f'{problem.measured.source}: the nominal parameters give no finite points')


def _try_probe_fit(problem: Problem) -> tuple[ProbeFit | None, list[str]]:
    """Eq. 15 as a start for P; an active probe whose readings cannot tell it gets a warning."""
    if isinstance(problem.measured.probe, PassiveProbe):
        return None, []
    try:
        return fit_probe(problem), []
    except RankError as error:
        return None, [str(error)]


def _start(evaluator: _Evaluator, table: ParameterTable, probe_fit: ProbeFit | None) -> Array:
    """Offsets to start from: nominal, or with the mount of eq. 15 where that fits better."""
    nominal = np.zeros(len(table.free_columns))
    if probe_fit is None:
        return nominal
    full = table.nominal.copy()
    mount = probe_fit.flange_T_probe
    full[-6:-3], full[-3:] = mount.translation, mount.rotation_vector
    fitted = full[table.free_columns] - table.nominal[table.free_columns]
    return fitted if evaluator(fitted).phi < evaluator(nominal).phi else nominal
