# SPDX-License-Identifier: Apache-2.0
"""`report.html`: a first page to sign, then what was measured, what came out, what to doubt."""

from __future__ import annotations

from typing import Any

from calib_model.errors import CalibrationError
from calib_solver.report.cover import SHOWN, cover
from calib_solver.report.evidence import charts_of
from calib_solver.report.html import (
    counted,
    document,
    facts,
    paragraph,
    part,
    section,
    side_by_side,
    table,
    warnings_box,
)
from calib_solver.report.instruments import inputs
from calib_solver.report.parameters import beyond, mount, parameters, repetitions
from calib_solver.report.points import point_annex
from calib_solver.report.quality import (
    full_quality,
    key_figures,
    measuring_arm,
    qualities,
    standards,
)
from calib_solver.report.residuals import (
    OBJECTIVES,
    by_joint,
    by_location,
    rejected,
    solver,
    sure,
    warnings,
)
from calib_solver.results import Info, Record, left_out_words


def report_html(record: Record, evidence: dict[str, Any], info: Info | None = None) -> str:
    """The page; every number in its tables is one of `record`, the content of result.json, and
    `evidence` what `evidence_of` says; `info` is what people know of it.

    Raises:
        CalibrationError: the record or the evidence is not what `identify` writes.
    """
    try:
        annex = point_annex if 'stations' in record else _annex
        sections = [cover(record, evidence, info or Info()), *annex(record, evidence)]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise CalibrationError(f'report: not what identify writes: {error!r}') from error
    return document(f'Kinematic calibration of {record["arm"]}', sections)


def _annex(record: Record, evidence: dict[str, Any]) -> list[str]:
    """All that is behind the first page."""
    columns = qualities(record)
    return [
        paragraph(_lead(record, evidence), 'faint'),
        _judged(record),
        warnings_box(warnings(record)[SHOWN:]),
        section('In short', key_figures(columns), sure(record)),
        section('What was measured', facts([tuple(row) for row in evidence['instruments']])),
        section('Quality', full_quality(columns), side_by_side(charts_of(evidence, 'quality'))),
        section('As a measuring arm', measuring_arm(columns)),
        section('As defined in ISO 10360-12 and ISO 9283', standards(columns)),
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
            side_by_side(charts_of(evidence, 'residuals'), 'three'),
            by_location(record),
            by_joint(record),
            side_by_side(charts_of(evidence, 'joints'), 'three'),
            rejected(record),
        ),
        beyond(record),
        section('Workspace', side_by_side(charts_of(evidence, 'workspace'))),
        section(
            'How it was computed',
            solver(record),
            side_by_side(charts_of(evidence, 'convergence')),
        ),
        section('Inputs and versions', *_inputs(evidence)),
    ]


def _inputs(evidence: dict[str, Any]) -> tuple[str, ...]:
    certificate = evidence['certificate']
    return (
        part('Certificate of the gauge'),
        table('', certificate['header'], certificate['rows'], range(1, 6)),
        inputs(evidence['files'], evidence['versions']),
    )


def _lead(record: Record, evidence: dict[str, Any]) -> str:
    objective = OBJECTIVES.get(record['objective'], record['objective'])
    return (
        f'{counted(evidence["poses"], "pose")} of {counted(evidence["spheres"], "sphere")} at '
        f'{counted(evidence["locations"], "location")} of the gauge {evidence["gauge"]}, '
        f'probed with {evidence["probe"]}; identified by {objective}.'
    )


def _judged(record: Record) -> str:
    """What the calibration is worth where it was not told anything."""
    left_out = record['quality']['left_out']
    if left_out is None:
        return ''
    words = left_out_words(left_out)
    return paragraph(f'{words[0].upper()}{words[1:]}.', 'judged')
