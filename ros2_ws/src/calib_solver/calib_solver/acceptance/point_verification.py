# SPDX-License-Identifier: Apache-2.0
"""A finished calibration by measured points on new ones: limits, or what it states of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calib_model.errors import DataError
from calib_model.kinematics import Correction
from calib_model.transforms import rotation_matrix
from calib_solver.acceptance.point_prediction import stated_points
from calib_solver.acceptance.prediction import Stated
from calib_solver.acceptance.stored_result import StoredResult
from calib_solver.acceptance.verdict import limit_lines, verdict_of, verdict_words
from calib_solver.calibration import Sources, load_points, unread_lines
from calib_solver.points import (
    Places,
    PlaceShares,
    PointProblem,
    PointQuality,
    fitted_quality,
    flange_of,
    known_quality,
    refuse_unknown_targets,
)
from calib_solver.results import Judged, Record, judge, point_quality_record, readings_record


@dataclass(frozen=True)
class PointVerification:
    """New points of `problem` under the arm and targets of a `result`, stations as they were
    identified or, where new, placed by their points; `nominal` has the nominal arm, with targets
    and stations where they fit it best. As `Verification`."""

    result: StoredResult
    bags: tuple[str, ...]
    problem: PointProblem
    quality: PointQuality
    nominal: PointQuality
    position: Stated
    limits: tuple[Judged, ...]
    notes: tuple[str, ...] = ()

    @property
    def distance(self) -> None:
        """Points have no distances of a gauge."""
        return None

    @property
    def within(self) -> bool:
        """Whether positions are as good as the calibration states."""
        return self.position.within

    @property
    def verdict(self) -> str:
        """`passed` or `failed` by limits; without any, `within` or `beyond` what was stated."""
        return verdict_of(self.limits, self.within)

    def worst(self) -> Record:
        """The point that is farthest from where it is predicted, numbered in the bag from 0."""
        row = int(np.argmax(self.quality.distance))
        place = int(self.problem.order[row])
        points = self.problem.measured.points
        return {
            'pose': place,
            'target': str(points.target[place]),
            'station': int(points.station[place]),
            'error': float(self.quality.distance[row]),
        }

    def record(self) -> Record:
        """What `verify --json` says, SI."""
        return {
            'verdict': self.verdict,
            'result': self.result.folder,
            'bags': list(self.bags),
            'arm': self.result.arm.name,
            'poses': len(self.problem),
            'readings': readings_record(self.problem.measured.points),
            'limits': [one.record() for one in self.limits],
            'stated': {
                'within': self.within,
                'position': vars(self.position) | {'within': self.within},
                'distance': None,
            },
            'quality': point_quality_record(self.quality),
            'nominal': point_quality_record(self.nominal),
            'spheres': [],
            'worst': self.worst(),
            'notes': list(self.notes),
        }

    def lines(self) -> list[str]:
        """The verification for people, mm."""
        position, worst = self.position, self.worst()
        return [
            *self.notes,
            f'{self.result.arm.name}: {len(self.problem)} new points',
            f'position error: {position.rms * 1e3:.4f} mm rms of {position.count}, stated '
            f'{position.stated * 1e3:.4f} mm: {"within" if position.within else "beyond"} '
            f'{position.bound * 1e3:.4f} mm',
            f'farthest from where it is predicted: point {worst["pose"]}, target '
            f'{worst["target"]}, station {worst["station"]}: {worst["error"] * 1e3:.4f} mm',
            *limit_lines(self.limits),
            verdict_words(self.verdict),
        ]


def verify_points(
    sources: Sources, result: StoredResult, allowed: Mapping[str, float]
) -> PointVerification:
    """The calibration of a result on the points of bags, none of them left out.

    Raises:
        CalibrationError: a bag cannot be used, the result is not by measured points or knows
            another arm or other targets, or a limit is set for what points cannot tell.
    """
    shares = result.stated.places
    if shares is None:
        raise DataError(
            f'{result.folder}: calibrated by probing poses, {sources.bags[0]} holds measured '
            'points: the place of its targets on the flange is not known'
        )
    loaded = load_points(sources)
    measured = loaded.measured
    if measured.arm.joint_names != result.arm.joint_names:
        raise DataError(f'{measured.source}: other joints than in {result.folder}')
    measured = replace(measured, arm=result.arm)
    refuse_unknown_targets(measured, shares.targets)
    problem = PointProblem.of(measured, shares.targets)
    problem.refuse_too_few()
    stations = tuple(one.number for one in shares.stations)
    weight = result.record['diagnostics'].get('orientation_weight')
    problem = problem.turns_weighing(weight if weight is not None else 1.0)
    notes = (*unread_lines(sources.bags), *loaded.notes, *loaded.warnings)
    notes = (*notes, *_sigma_lines(problem, shares))
    problem = problem.weighed_as(shares.unit_sigma)
    correction: Correction | None = result.calibrated.correction
    flange = flange_of(problem, result.arm, correction)
    quality = known_quality(problem, flange, _places(result, shares), stations)
    return PointVerification(
        result,
        sources.bags,
        problem,
        quality,
        fitted_quality(problem, result.calibrated.nominal),
        stated_points(result, shares, problem, quality),
        tuple(judge(allowed, point_quality_record(quality), ', '.join(sources.bags))),
        notes,
    )


def _sigma_lines(problem: PointProblem, shares: PlaceShares) -> tuple[str, ...]:
    """A line where how good the points are is stated of only these or only the calibration's."""
    if bool(problem.unit_sigma) == bool(shares.unit_sigma):
        return ()
    has, lacks = ('these', "the calibration's")[:: 1 if problem.unit_sigma else -1]
    return (f'{has} points state a sigma and {lacks} do not: they are taken to be as good',)


def _places(result: StoredResult, shares: PlaceShares) -> Places:
    """Targets and stations as they were identified, in the order of the shares; stations with the
    correction of eq. 12 where there is one."""
    targets = {one['target']: one for one in result.record['targets']}
    corrected = (result.record['correction'] or {}).get('stations')
    stations = {one['station']: one for one in corrected or result.record['stations']}
    of_target = [targets[name] for name in shares.targets]
    of_station = [stations[one.number] for one in shares.stations]
    turns, bases = (
        np.array(
            [rotation_matrix(np.array(one['rotation_vector'] or (0.0, 0.0, 0.0))) for one in of]
        )
        for of in (of_target, of_station)
    )
    held, placed = (np.array([one['translation'] for one in of]) for of in (of_target, of_station))
    return Places(bases, placed, turns, held)
