# SPDX-License-Identifier: Apache-2.0
"""What each service does: from a request's fields, as calib_interfaces names them, to a record of
which the answer is filled."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from typing import Any

import numpy as np

from calib_model.bags import Temperature
from calib_model.bounds import TEMPERATURE
from calib_model.errors import DataError
from calib_model.labelling import RawSettings
from calib_model.stamps import TIMED_BY
from calib_model.topics import RawTopics
from calib_solver import acceptance
from calib_solver.calibration import (
    Calibration,
    Effort,
    PointCalibration,
    Sources,
    bag_list,
    calibrate,
    calibrate_points,
    evaluation_record,
    fit_probe_from,
    hold_points,
    in_one_line,
)
from calib_solver.compensation import TargetTable, compensate_file, rows_of
from calib_solver.error_models import chosen_kinds
from calib_solver.fitting import Options, chosen_prior
from calib_solver.resampling import Plan
from calib_solver.results import Record, checked_limits
from calib_solver.serving.opened import Opened
from calib_solver.serving.residual_lines import point_residuals, residuals

Request = Any  # an object with the fields of a request of calib_interfaces


def identify(request: Request, opened: Opened) -> Record:
    """Eq. 11: `result` as in result.json, `residuals` to look at."""
    own = (_path(request.prior), request.urdf, request.links)
    reads = [request.bag, request.test, *_descriptions(request), *own]
    opened.permit(reads, request.output, request.scheduler)
    sources = _with_raw(request)
    points = hold_points(sources)
    options = Options(
        request.objective or ('position' if points else Options.objective),
        tuple(request.fix),
        tuple(request.free),
        chosen_prior(request.prior),
        request.loss or Options.loss,
        request.correction or Options.correction,
        chosen_kinds(request.joint_errors),
        quick=request.quick,
    )
    effort = Effort(Plan(request.monte_carlo, request.bootstrap, request.seed), request.scheduler)
    given = sources, options, bag_list(request.test), request.output, effort, request.urdf
    finished: Calibration | PointCalibration
    if points:
        finished = by_points = calibrate_points(*given)
        shown = point_residuals(by_points.done)
    else:
        finished = by_poses = calibrate(*given)
        shown = residuals(by_poses.done)
    return {
        'result': finished.record,
        'notes': list(finished.notes),
        'written': [str(path) for path in finished.written],
        'message': in_one_line(finished),
        'frame': finished.done.arm.base_frame,
        'residuals': shown,
    }


def fit_probe(request: Request, opened: Opened) -> Record:
    """Eq. 15."""
    opened.permit([request.bag, *_descriptions(request)], request.output)
    fitted = fit_probe_from(_sources(request), request.output)
    written = [str(path) for path in fitted.written]
    return {**fitted.record, 'written': written, 'message': fitted.verdict}


def evaluate(request: Request, opened: Opened) -> Record:
    """Q of the contract, and the spheres."""
    opened.permit([request.bag, *_descriptions(request), request.correction], '')
    record = evaluation_record(_sources(request), request.correction)
    what = f'{len(record["spheres"])} spheres' if 'spheres' in record else ''
    return {
        **record,
        'message': f'{what or str(record["position"]["count"]) + " points"} evaluated',
    }


def compensate(request: Request, opened: Opened) -> Record:
    """Joint commands that really get there."""

    def rows(n: int) -> TargetTable:
        position, turn = np.array(request.position), np.array(request.rotation_vector)
        return rows_of(n, position, turn, np.array(request.joint_position))

    opened.permit([request.result, request.table], request.output)
    finished = compensate_file(
        request.result,
        request.table or rows,
        request.output,
        request.tool,
        request.position_only,
    )
    joints = finished.done.joints
    return {
        'rows': len(joints),
        'joint_command': joints.reshape(-1).tolist(),
        'miss_mean': float(finished.miss.mean()),
        'miss_max': float(finished.miss.max()),
        'change_max': finished.change,
        'written': [str(path) for path in finished.written],
        'message': '; '.join((finished.verdict, *finished.notes)),
    }


def verify(request: Request, opened: Opened) -> Record:
    """A calibration on new poses, as the command tells it."""
    opened.permit([request.bag, request.result, request.gauge, request.limits], request.output)
    sources = Sources(bag_list(request.bag), gauge=request.gauge)
    found = acceptance.verify(sources, request.result, request.limits, more=_limits(request))
    written = [acceptance.write_verification(found, request.output)] if request.output else []
    return {
        **found.record(),
        'written': [str(path) for path in written],
        'message': '; '.join(acceptance.verification_lines(found)[::-1]),
    }


def compare(request: Request, opened: Opened) -> Record:
    """What changed between calibrations, as the command tells it."""
    opened.permit(list(request.results), request.output)
    found = acceptance.compare(list(request.results))
    written = [acceptance.write_comparison(found, request.output)] if request.output else []
    return {
        **found.record(),
        'written': [str(path) for path in written],
        'message': '; '.join((found.verdict, *found.notes)),
    }


def _sources(request: Request) -> Sources:
    return Sources(bag_list(request.bag), request.arm, request.probe, request.gauge)


def _descriptions(request: Request) -> tuple[str, str, str]:
    return request.arm, request.probe, request.gauge


def _limits(request: Request) -> dict[str, float]:
    """The limits that stand in a request itself.

    Raises:
        CalibrationError: there are not as many values as names, or one is unknown.
    """
    names, values = list(request.limit_names), list(request.limit_values)
    if len(names) != len(values):
        raise DataError(f'limit_values: expected {len(names)}, one a name, got {len(values)}')
    return checked_limits(dict(zip(names, values, strict=True)))


def _path(prior: str) -> str:
    """A prior that is a file's path, not a word or a strength."""
    return prior if os.sep in prior or os.path.exists(prior) else ''


def _with_raw(request: Request) -> Sources:
    """The sources of an identification, with what is said of bags without poses."""
    topics = RawTopics(
        request.joint_states or RawTopics.joint_states,
        request.displacements or RawTopics.displacements,
        tuple(request.joints),
    )
    stamps = request.stamps or 'auto'
    if stamps not in TIMED_BY:
        raise DataError(f'stamps: expected one of {", ".join(TIMED_BY)}, got {stamps!r}')
    choice = RawSettings(topics, tuple(int(number) for number in request.spheres), stamps=stamps)
    return replace(
        _sources(request),
        links=request.links,
        raw=choice,
        anew=request.raw,
        temperature=_temperature(request),
    )


def _temperature(request: Request) -> Temperature | None:
    if not request.temperature > TEMPERATURE[0]:  # NaN, too
        return None
    sure = request.temperature_uncertainty
    return Temperature(request.temperature, 0.0 if math.isnan(sure) else sure)
