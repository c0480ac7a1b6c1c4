# SPDX-License-Identifier: Apache-2.0
"""A calibration by measured points, from bags to files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib_model.descriptions import (
    parse_arm,
    parse_correction,
    read_description,
    read_links,
)
from calib_model.errors import DataError
from calib_model.measured_points import PointMeasurement
from calib_model.progress import Progress
from calib_model.tracking import read_tracked
from calib_solver import compensation, report
from calib_solver.calibration.calibration import Effort, inputs, own_urdf, write_reported
from calib_solver.calibration.sources import Sources, unread_lines
from calib_solver.fitting import Options
from calib_solver.points import (
    HeldOutPoints,
    PointIdentification,
    PointProblem,
    checked_point_options,
    fitted_quality,
    held_out_points,
    identify_points,
    joined_points,
)
from calib_solver.problem import threads
from calib_solver.resampling import (
    Resampled,
    Spread,
    connected,
    in_processes,
    refuse_repetitions,
    resample_points,
)
from calib_solver.results import (
    Record,
    point_quality_record,
    point_result_record,
    refuse_no_place,
)


@dataclass(frozen=True)
class PointCalibration:
    """A finished `identify` of measured points: as `Calibration`."""

    done: PointIdentification
    held_out: HeldOutPoints | None
    record: Record
    written: tuple[Path, ...]
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """How it went, in one line."""
        return self.done.fit.verdict


@dataclass(frozen=True)
class LoadedPoints:
    """The points of bags, `warnings` of what was left out as copies, and `notes` on how they were
    read."""

    measured: PointMeasurement
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def load_points(sources: Sources) -> LoadedPoints:
    """The points of one or several bags.

    Raises:
        CalibrationError: a bag or a description cannot be read, they do not go together, or
            something is given that points do not have.
    """
    for name in ('probe', 'gauge'):
        if getattr(sources, name):
            raise DataError(f'--{name}: measured points take no {name}')
    if sources.temperature is not None:
        raise DataError('--temperature: measured points have no gauge')
    arm = read_description(sources.arm, parse_arm) if sources.arm else None
    raw = sources.raw
    found = [read_tracked(bag, arm, raw.topics, raw.stamps) for bag in sources.bags]
    measured = joined_points([each.measured for each in found])
    notes = tuple(line for each in found for line in each.lines)
    points = measured.points
    names = np.unique(points.target, return_inverse=True)[1].reshape(-1)
    rows = np.column_stack([names, points.station, points.joints, points.position]) + 0.0
    packed = np.ascontiguousarray(rows).view(f'V{rows.shape[1] * rows.itemsize}').reshape(-1)
    first = np.unique(packed, return_index=True)[1]
    copies = len(points) - len(first)
    if not copies:
        return LoadedPoints(measured, (), notes)
    measured = replace(measured, points=points.take(np.sort(first)))
    return LoadedPoints(
        measured, (f'{copies} points are copies of others: each counts once',), notes
    )


def calibrate_points(
    sources: Sources,
    options: Options,
    test: Sequence[str] = (),
    output: str = '',
    effort: Effort | None = None,
    urdf: str = '',
) -> PointCalibration:
    """Identify from bags of points, judge on held-out ones, write the results.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    effort = effort or Effort()
    options = checked_point_options(options)
    refuse_repetitions(effort.plan)
    if output:
        refuse_no_place(output)
    own = own_urdf(urdf, output)
    unseen = load_points(replace(sources, bags=tuple(test))) if test else None
    loaded = load_points(sources)
    measured = loaded.measured
    if urdf:
        compensation.refuse_uncorrectable(own, measured.arm, urdf)
    if sources.links:
        options = replace(options, links=read_links(sources.links, measured.arm))
    done, resampled = _identified(measured, options, effort)
    held_out = held_out_points(unseen.measured, done) if unseen is not None else None
    first = unread_lines((*sources.bags, *test))
    first = (*first, *loaded.warnings)
    done = replace(done, warnings=(*first, *done.warnings))
    record = point_result_record(done, held_out, resampled)
    more: dict[str, bytes] = {}
    if urdf:
        more['robot.urdf'] = compensation.corrected_urdf(own, measured.arm, done.arm, urdf)
    written: tuple[Path, ...] = ()
    if output:
        evidence = report.point_evidence_of(done, inputs(sources, test), held_out)
        written = write_reported(output, done, record, evidence, more)
    notes = (*loaded.notes, *(unseen.notes if unseen is not None else ()))
    return PointCalibration(done, held_out, record, written, notes)


def _identified(
    measured: PointMeasurement, options: Options, effort: Effort
) -> tuple[PointIdentification, Resampled | None]:
    """The identification, and its repetitions on this machine or on a cluster."""
    if not effort.scheduler:
        done = identify_points(measured, options)
        return done, _resampled(done, effort, in_processes(threads()))
    with connected(effort.scheduler) as cluster:
        # a pass over the points is over sooner than they would be there
        done = identify_points(measured, options)
        return done, _resampled(done, effort, cluster.spread)


def _resampled(done: PointIdentification, effort: Effort, spread: Spread) -> Resampled | None:
    if effort.plan.empty:
        return None
    return resample_points(done, effort.plan, spread, effort.progress)


def point_evaluation_record(
    sources: Sources, correction: str = '', progress: Progress | None = None
) -> Record:
    """The quality of given parameters on points, targets and stations where they fit best;
    `progress` hears what was made of bags without joints.

    Raises:
        CalibrationError: a bag or a description cannot be used.
    """
    beyond = read_description(correction, parse_correction) if correction else None
    loaded = load_points(sources)
    measured = loaded.measured
    if progress is not None:
        for line in (*loaded.warnings, *loaded.notes):
            progress.say(line)
    problem = PointProblem.of(measured)
    problem.refuse_too_few()
    return point_quality_record(fitted_quality(problem, measured.arm, beyond))
