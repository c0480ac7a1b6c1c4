# SPDX-License-Identifier: Apache-2.0
"""Measurements and results from the paths that a command line or a service request names."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.bag import read_measurement
from calib_model.description import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.errors import DataError
from calib_model.probing import Measurement, ProbingSet
from calib_model.progress import Progress
from calib_solver.cluster import connected
from calib_solver.compiled import threads
from calib_solver.identification import Identification, Options, identify
from calib_solver.parallel import Spread, in_processes
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess
from calib_solver.report import report_html
from calib_solver.resampling import Plan, Resampled, refuse_plan, resample
from calib_solver.result import Record, result_record, write_results


@dataclass(frozen=True)
class Sources:
    """Bags that make one measurement, and YAML files that take the place of their descriptions."""

    bags: tuple[str, ...]
    arm: str = ''
    probe: str = ''
    gauge: str = ''


def bag_list(text: str) -> tuple[str, ...]:
    """The bags a request names: one path, or several separated by ':'."""
    if not text or os.path.exists(text):
        return (text,) if text else ()
    return tuple(part for part in text.split(':') if part)


def load(sources: Sources) -> Measurement:
    """The measurement of one or several bags; each further bag's locations are its own.

    Raises:
        CalibrationError: a bag or a description cannot be read, or they do not go together.
    """
    if not sources.bags:
        raise DataError('no bag given')
    arm = read_description(sources.arm, parse_arm) if sources.arm else None
    probe = read_description(sources.probe, parse_probe) if sources.probe else None
    gauge = read_description(sources.gauge, parse_gauge) if sources.gauge else None
    parts = [read_measurement(bag, arm, probe, gauge) for bag in sources.bags]
    return parts[0] if len(parts) == 1 else _joined(parts)


def _joined(parts: Sequence[Measurement]) -> Measurement:
    """Bags of one arm as one measurement; a location number used twice is moved up."""
    first = parts[0]
    sets: list[ProbingSet] = []
    used: set[int] = set()
    for part in parts:
        if part.arm.joint_names != first.arm.joint_names:
            raise DataError(f'{part.source}: other joints than in {first.source}')
        if part.probe.kind != first.probe.kind:
            raise DataError(
                f'{part.source}: {part.probe.kind} probe, but {first.source} is {first.probe.kind}'
            )
        if not np.array_equal(part.arm.geometry, first.arm.geometry):
            raise DataError(f'{part.source}: other nominal parameters than in {first.source}')
        if part.gauge != first.gauge:
            raise DataError(f'{part.source}: another gauge than in {first.source}')
        own = set(map(int, part.poses.location))
        shift = max(used) + 1 - min(own) if own & used else 0
        used |= {number + shift for number in own}
        poses = part.poses
        sets.append(
            ProbingSet(
                np.asarray(poses.location) + shift, poses.sphere, poses.joints,
                poses.displacement, poses.stamp, poses.readings,
            )
        )  # fmt: skip
    source = ', '.join(part.source for part in parts)
    return Measurement(first.arm, first.probe, first.gauge, ProbingSet.joined(sets), source)


@dataclass(frozen=True)
class Calibration:
    """A finished `identify`: the identification, the held-out qualities, the record, the files."""

    done: Identification
    test_initial: Quality | None
    test: Quality | None
    record: Record
    written: tuple[Path, ...]

    @property
    def verdict(self) -> str:
        """How it went, in one line."""
        fit = self.done.fit
        outcome = 'converged' if fit.converged else 'NOT CONVERGED'
        return f'{outcome} after {fit.iterations} iterations: {fit.reason}'


@dataclass(frozen=True)
class Effort:
    """Work beyond a single identification, and where it is done.

    `scheduler` is the address of a Dask scheduler; '' is this machine alone. `progress` is told
    how far the repetitions are.
    """

    plan: Plan = Plan()
    scheduler: str = ''
    progress: Progress | None = None


def calibrate(
    sources: Sources,
    options: Options,
    test: Sequence[str] = (),
    output: str = '',
    effort: Effort | None = None,
) -> Calibration:
    """Identify from bags, judge on held-out ones, write the results: command and service alike.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    held_out = (
        load(Sources(tuple(test), sources.arm, sources.probe, sources.gauge)) if test else None
    )
    done, resampled = _identified(load(sources), options, effort or Effort())
    before = after = None
    if held_out is not None:
        problem = Problem.of(held_out)
        measured = done.problem.measured
        before = assess(problem, measured.arm, measured.probe)
        after = assess(problem, done.arm, done.probe)
    record = result_record(done, after, resampled)
    written: list[Path] = []
    if output:
        report = report_html(done, record, sources.bags, test, before, after)
        written = write_results(output, done, record, report)
    return Calibration(done, before, after, record, tuple(written))


def _identified(
    measured: Measurement, options: Options, effort: Effort
) -> tuple[Identification, Resampled | None]:
    """The identification and its repetitions, on this machine or on a cluster."""
    plan, progress = effort.plan, effort.progress
    refuse_plan(plan, len(np.unique(measured.poses.location)), measured.source)
    if not effort.scheduler:
        done = identify(measured, options)
        return done, _resampled(done, plan, in_processes(threads()), progress)
    with connected(effort.scheduler) as cluster:
        done = identify(measured, options, cluster.passes())
        return done, _resampled(done, plan, cluster.spread, progress)


def _resampled(
    done: Identification, plan: Plan, spread: Spread, progress: Progress | None
) -> Resampled | None:
    return resample(done, plan, spread, progress) if plan != Plan(seed=plan.seed) else None
