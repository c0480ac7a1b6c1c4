# SPDX-License-Identifier: Apache-2.0
"""What `result.json` says of a calibration by measured points: the same keys, as far as they go."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import CLASSIC
from calib_solver.points import HeldOutPoints, Placed, PointIdentification, PointQuality
from calib_solver.problem import IntArray
from calib_solver.results.corrections import choice_record, joint_errors_record
from calib_solver.results.diagnostics import finite, joint_shares, prior_record
from calib_solver.results.files import (
    SCHEMA,
    parameter_records,
    solver_record,
    transform_record,
)
from calib_solver.results.quality import Record, left_out_record
from calib_solver.results.readings import readings_record
from calib_solver.results.resampling import resampling_record

if TYPE_CHECKING:
    from calib_solver.resampling import Resampled


def point_result_record(
    done: PointIdentification,
    held_out: HeldOutPoints | None = None,
    resampled: Resampled | None = None,
) -> Record:
    """The content of `result.json`."""
    test, before = (None, None) if held_out is None else (held_out.identified, held_out.initial)
    return {
        'schema': SCHEMA,
        'arm': done.arm.name,
        'objective': done.options.objective,
        'convention': {'parameters': CLASSIC, 'described_in': done.arm.described_in},
        'parameters': parameter_records(done.estimates),
        'flange_T_probe': transform_record(done.probe.flange_T_probe),
        'targets': [target_record(target) for target in done.targets],
        'stations': [station_record(station) for station in done.stations],
        'spheres': [],
        'quality': {
            'initial': point_quality_record(done.initial),
            'identified': point_quality_record(done.identified),
            'test': point_quality_record(test) if test is not None else None,
            'test_initial': point_quality_record(before) if before is not None else None,
            'left_out': left_out_record(done.left_out) if done.left_out is not None else None,
        },
        'solver': solver_record(done.fit, done.seconds),
        'probe_fit': None,
        'readings': readings_record(done.problem.measured.points),
        'warnings': list(done.warnings),
        'rejected': [vars(one) for one in done.rejected],
        'diagnostics': _diagnostics(done),
        'resampling': resampling_record(done, resampled) if resampled is not None else None,
        'joint_errors': joint_errors_record(done),
        'correction': _correction(done, held_out),
    }


def _correction(done: PointIdentification, held_out: HeldOutPoints | None) -> Record | None:
    """What came of eq. 12; `stations` are where they are with it, targets where they were."""
    if done.choice_12 is None:
        return None
    record = {**choice_record(done.choice_12), 'stations': None}
    if done.corrected is not None:
        test = held_out.corrected if held_out is not None else None
        record['quality'] = {
            'identified': point_quality_record(done.corrected),
            'test': point_quality_record(test) if test is not None else None,
        }
        record['stations'] = [
            {'station': number, **transform_record(at)} for number, at in done.corrected_stations
        ]
    return record


def target_record(target: Placed) -> Record:
    """A target's place on the flange, m and rad; no rotation where none was measured."""
    turn = target.rotation_uncertainty
    return {
        'target': target.name,
        'points': target.points,
        'translation': target.transform.translation.tolist(),
        'rotation_vector': None if turn is None else target.transform.rotation_vector.tolist(),
        'standard_uncertainty': target.translation_uncertainty.tolist(),
        'rotation_uncertainty': None if turn is None else turn.tolist(),
    }


def station_record(station: Placed) -> Record:
    """The base in a tracker's frame, m and rad."""
    turn = station.rotation_uncertainty
    return {
        'station': int(station.name),
        'points': station.points,
        **transform_record(station.transform),
        'standard_uncertainty': station.translation_uncertainty.tolist(),
        'rotation_uncertainty': None if turn is None else turn.tolist(),
    }


def point_quality_record(quality: PointQuality) -> Record:
    """Q of the contract for points, m and rad; null is what only a gauge has."""
    return {
        'phi': quality.phi,
        'distance': None,
        'two_sigma': None,
        'position': _sizes(quality.distance),
        'orientation': _sizes(quality.angle) if len(quality.angle) else None,
        'measuring_arm': None,
        'standards': None,
    }


def _sizes(size: Array) -> Record:
    return {
        'rms': float(np.sqrt(np.mean(size**2))),
        'mean': float(size.mean()),
        'max': float(size.max()),
        'count': len(size),
    }


def _diagnostics(done: PointIdentification) -> dict[str, Any]:
    sure, problem = done.position_uncertainty, done.problem
    return {
        'rank': done.observability.rank,
        'free': len(done.fit.x),
        'condition': finite(done.observability.condition),
        'noise': done.uncertainty.noise,
        'orientation_noise': done.turn_noise,
        'orientation_weight': problem.turn_weight if problem.has_orientation else None,
        'misfit': done.uncertainty.misfit,
        'prior': prior_record(done),
        'position_uncertainty_rms': float(np.sqrt(np.mean(sure**2))),
        'position_uncertainty_max': float(sure.max()),
        'by_location': [],
        'by_station': _by(done, problem.station, [str(one) for one in problem.stations]),
        'by_target': _by(done, problem.target, list(problem.targets)),
        'by_joint': joint_shares(done.arm.joint_names, problem.joints, done.identified.position),
        'untold': [],
        'scale': None,
    }


def _by(done: PointIdentification, which: IntArray, names: list[str]) -> list[dict[str, Any]]:
    """Residuals of each station, or target."""
    sizes = (done.identified.distance[which == number] for number in range(len(names)))
    named = zip(names, sizes, strict=True)
    return [{'name': name, **_sizes(size)} for name, size in named if len(size)]
