# SPDX-License-Identifier: Apache-2.0
"""`report.html`: what was measured with what, what came out, how sure it is, and what to doubt."""

from __future__ import annotations

from datetime import datetime, timezone
from html import escape

from calib_solver.held_out import HeldOut
from calib_solver.identification import Identification
from calib_solver.report.corrections import beyond
from calib_solver.report.figures import (
    convergence_chart,
    joint_charts,
    quality_charts,
    residual_charts,
)
from calib_solver.report.html import (
    counted,
    document,
    paragraph,
    part,
    section,
    side_by_side,
    warnings_box,
)
from calib_solver.report.instruments import Inputs, certificate, inputs, instruments
from calib_solver.report.parameters import mount, parameters, repetitions
from calib_solver.report.quality import Columns, full_quality, key_figures, measuring_arm
from calib_solver.report.residuals import (
    OBJECTIVES,
    by_joint,
    by_location,
    rejected,
    solver,
    sure,
    warnings,
)
from calib_solver.report.workspace import workspace_charts
from calib_solver.results import Record, left_out_words


def report_html(
    done: Identification, record: Record, given: Inputs, held_out: HeldOut | None = None
) -> str:
    """The page; every number in its tables is one of `record`, the content of result.json."""
    title = f'Kinematic calibration of {record["arm"]}'
    columns = _columns(record)
    sections = [
        '<header><p class="kind">Calibration report</p>',
        f'<h1>{escape(title)}</h1>',
        paragraph(_lead(done, record), 'faint'),
        _judged(record),
        '</header>',
        warnings_box(warnings(record)),
        section('In short', key_figures(columns), sure(record)),
        section('What was measured', instruments(done, held_out)),
        section('Quality', full_quality(columns), side_by_side(quality_charts(done, held_out))),
        section('As a measuring arm', measuring_arm(columns)),
        section(
            'Parameters',
            parameters(record),
            part('The probe on the flange'),
            mount(record),
            repetitions(record),
        ),
        section(
            'Residuals',
            paragraph('Each pose against the mean of its sphere (eq. 12), in the arm base frame.'),
            side_by_side(residual_charts(done, held_out), 'three'),
            by_location(record),
            by_joint(record),
            side_by_side(joint_charts(done), 'three'),
            rejected(record),
        ),
        beyond(record),
        section('Workspace', side_by_side(workspace_charts(done, held_out))),
        section('How it was computed', solver(record), side_by_side([convergence_chart(done)])),
        section(
            'Inputs and versions',
            certificate(done.problem.measured.gauge),
            inputs(given),
            _signatures(),
        ),
    ]
    return document(title, sections)


def _lead(done: Identification, record: Record) -> str:
    objective = OBJECTIVES.get(record['objective'], record['objective'])
    measured = done.problem.measured
    return (
        f'{counted(len(done.problem.joints), "pose")} of '
        f'{counted(len(done.problem.keys), "sphere")} at '
        f'{counted(len(done.problem.locations), "location")} of the gauge {measured.gauge.name}, '
        f'probed with {measured.probe.name}; identified by {objective}. '
        f'Report made {datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC.'
    )


def _judged(record: Record) -> str:
    """What the calibration is worth where it was not told anything."""
    left_out = record['quality']['left_out']
    if left_out is None:
        return ''
    words = left_out_words(left_out)
    return paragraph(f'{words[0].upper()}{words[1:]}.', 'judged')


def _columns(record: Record) -> Columns:
    """The qualities side by side, those with eq. 12's correction where it was accepted."""
    quality = record['quality']
    corrected = (record.get('correction') or {}).get('quality') or {}
    columns = {'initial': quality['initial'], 'identified': quality['identified']}
    if corrected:
        columns['corrected'] = corrected['identified']
    if quality['test'] is not None:
        columns['held out, initial'] = quality['test_initial']
        columns['held out, identified'] = quality['test']
        if corrected:
            columns['held out, corrected'] = corrected['test']
    return columns


def _signatures() -> str:
    lines = ''.join(f'<div>{name}</div>' for name in ('Measured by', 'Calibrated by', 'Date'))
    return f'<div class="sign">{lines}</div>'
