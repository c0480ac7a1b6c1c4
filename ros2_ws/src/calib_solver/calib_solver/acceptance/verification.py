# SPDX-License-Identifier: Apache-2.0
"""A finished calibration on new poses: does it keep its limits, or what it states of itself?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib_model.descriptions import read_description
from calib_model.errors import DataError
from calib_model.labelling import Instruments
from calib_model.progress import Progress
from calib_solver.acceptance.point_verification import PointVerification, verify_points
from calib_solver.acceptance.prediction import Stated, stated_errors
from calib_solver.acceptance.stored_result import StoredResult, read_result
from calib_solver.acceptance.verdict import limit_lines, verdict_of, verdict_words
from calib_solver.calibration import Sources, duplicate_lines, hold_points, load_all, unread_lines
from calib_solver.held_out import refuse_other_instruments
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess
from calib_solver.results import (
    Judged,
    Record,
    judge,
    parse_limits,
    quality_record,
    reading_times,
    sphere_records,
)


@dataclass(frozen=True)
class Verification:
    """New poses of `problem` under the arm of a `result`: their quality by the calibration and by
    the nominal arm, what was stated for them, and how they stand to limits, if there are any."""

    result: StoredResult
    bags: tuple[str, ...]
    problem: Problem
    quality: Quality
    nominal: Quality
    position: Stated
    distance: Stated | None
    limits: tuple[Judged, ...]
    notes: tuple[str, ...] = ()

    @property
    def within(self) -> bool:
        """Whether positions and distances are as good as the calibration states."""
        return self.position.within and (self.distance is None or self.distance.within)

    @property
    def verdict(self) -> str:
        """`passed` or `failed` by limits; without any, `within` or `beyond` what was stated."""
        return verdict_of(self.limits, self.within)

    def worst(self) -> Record:
        """The pose that is farthest from its place, as it is numbered in the measurement from 0."""
        row = int(np.argmax(self.quality.position))
        place = int(self.problem.order[row])
        poses = self.problem.measured.poses
        return {
            'pose': place,
            'location': int(poses.location[place]),
            'sphere': int(poses.sphere[place]),
            'error': float(self.quality.position[row]),
        }

    def record(self) -> Record:
        """What `verify --json` says, SI."""
        span = reading_times(self.problem.measured.poses)
        first, last = (None, None) if span is None else (t.isoformat('T', 'seconds') for t in span)
        return {
            'verdict': self.verdict,
            'result': self.result.folder,
            'bags': list(self.bags),
            'arm': self.result.arm.name,
            'poses': len(self.problem.joints),
            'readings': {'first': first, 'last': last},
            'limits': [one.record() for one in self.limits],
            'stated': {
                'within': self.within,
                'position': vars(self.position) | {'within': self.position.within},
                'distance': None
                if self.distance is None
                else vars(self.distance) | {'within': self.distance.within},
            },
            'quality': quality_record(self.quality),
            'nominal': quality_record(self.nominal),
            'spheres': sphere_records(self.quality.spheres),
            'worst': self.worst(),
            'notes': list(self.notes),
        }


def verify(
    sources: Sources,
    folder: str,
    limits: str = '',
    progress: Progress | None = None,
    more: Mapping[str, float] | None = None,
) -> Verification | PointVerification:
    """The calibration in `folder` on the poses, or measured points, of bags, none of them left
    out; `limits` is a file's path, `more` are limits (m) beside those of the file.

    Raises:
        CalibrationError: a bag, the result or the limits cannot be used, or a limit is set for
            what these poses cannot tell.
    """
    allowed = read_description(limits, parse_limits) if limits else {}
    allowed |= dict(more or {})
    result = read_result(folder)
    if hold_points(sources):
        return verify_points(sources, result, allowed)
    if result.stated.places is not None:
        raise DataError(
            f'{folder}: calibrated by measured points, {", ".join(sources.bags)} holds probing '
            'poses: the place of its probe on the flange is not known'
        )
    instead = Instruments(result.arm, result.probe)  # of a bag of raw topics alone
    loaded = load_all(replace(sources, instead=instead), progress)
    correction = result.calibrated.correction
    loaded = loaded.told_with(result.arm, result.probe, correction)
    measured = replace(loaded.measured, arm=result.arm, probe=result.probe)
    refuse_other_instruments(loaded.measured, replace(measured, source=folder))
    problem = Problem.of(measured)
    quality = assess(problem, result.arm, result.probe, correction)
    position, distance = stated_errors(result, problem, quality)
    judged = judge(allowed, quality_record(quality), ', '.join(sources.bags))
    return Verification(
        result,
        sources.bags,
        problem,
        quality,
        assess(problem, result.calibrated.nominal, result.nominal_probe),
        position,
        distance,
        tuple(judged),
        (*unread_lines(sources.bags), *duplicate_lines(loaded.duplicates), *loaded.lines),
    )


def verification_lines(found: Verification | PointVerification) -> list[str]:
    """The verification for people, mm."""
    if isinstance(found, PointVerification):
        return found.lines()
    lines = list(found.notes)
    locations = len(found.problem.locations)
    lines.append(
        f'{found.result.arm.name}: {len(found.problem.joints)} new poses of '
        f'{len(found.problem.keys)} spheres at {locations} location{"s"[: locations != 1]}'
    )
    for name, one in (('position', found.position), ('distance', found.distance)):
        if one is not None:
            lines.append(
                f'{name} error: {one.rms * 1e3:.4f} mm rms of {one.count}, stated '
                f'{one.stated * 1e3:.4f} mm: {"within" if one.within else "beyond"} '
                f'{one.bound * 1e3:.4f} mm'
            )
    worst = found.worst()
    lines.append(
        f'farthest from its place: pose {worst["pose"]}, location {worst["location"]}, sphere '
        f'{worst["sphere"]}: {worst["error"] * 1e3:.4f} mm'
    )
    return [*lines, *limit_lines(found.limits), verdict_words(found.verdict)]
