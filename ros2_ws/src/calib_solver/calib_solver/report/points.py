# SPDX-License-Identifier: Apache-2.0
"""The report of a calibration by measured points: in the words of a tracker."""

from __future__ import annotations

from typing import Any

from calib_model.arrays import Array
from calib_solver.points import HeldOutPoints, PointIdentification
from calib_solver.report.charts import Chart, Series
from calib_solver.report.cover import SHOWN
from calib_solver.report.evidence import SCHEMA, chart_records, charts_of
from calib_solver.report.figures import convergence_of, thinned
from calib_solver.report.html import (
    DEGREE,
    MM,
    NOTHING,
    counted,
    mm,
    paragraph,
    part,
    section,
    side_by_side,
    table,
    two_digits,
    warnings_box,
)
from calib_solver.report.instruments import Inputs, file_rows, inputs, versions
from calib_solver.report.parameters import beyond, parameters, repetitions
from calib_solver.report.quality import qualities
from calib_solver.report.residuals import by_joint, solver, warnings
from calib_solver.results import Record, left_out_words

SHOWN_REJECTED = 50


def point_evidence_of(
    done: PointIdentification, given: Inputs, held_out: HeldOutPoints | None = None
) -> dict[str, Any]:
    """The content of `report.json`."""
    problem = done.problem
    return {
        'schema': SCHEMA,
        'points': len(problem),
        'targets': len(problem.targets),
        'stations': len(problem.stations),
        'simulated': False,
        'files': file_rows(given),
        'versions': versions(),
        'charts': {
            'residuals': chart_records(point_clouds(done, held_out)),
            'convergence': chart_records([convergence_of(done.fit)]),
        },
    }


def point_annex(record: Record, evidence: dict[str, Any]) -> list[str]:
    """All that is behind the first page."""
    left_out = record['quality']['left_out']
    words = left_out_words(left_out) if left_out is not None else ''
    return [
        paragraph(_lead(evidence), 'faint'),
        paragraph(f'{words[0].upper()}{words[1:]}.', 'judged') if words else '',
        warnings_box(warnings(record)[SHOWN:]),
        section('In short', _quality(record), _sure(record)),
        section('Targets and stations', _targets(record), _stations(record)),
        section('Parameters', parameters(record), repetitions(record)),
        section(
            'Residuals',
            paragraph('Predicted less measured, in the arm base frame.'),
            side_by_side(charts_of(evidence, 'residuals'), 'three'),
            _by(record, 'station'),
            _by(record, 'target'),
            by_joint(record),
            _rejected(record),
        ),
        beyond(record),
        section(
            'How it was computed',
            solver(record),
            side_by_side(charts_of(evidence, 'convergence')),
        ),
        section('Inputs and versions', inputs(evidence['files'], evidence['versions'])),
    ]


def _lead(evidence: dict[str, Any]) -> str:
    return (
        f'{counted(evidence["points"], "point")} of {counted(evidence["targets"], "target")} on '
        f'the flange, measured from {counted(evidence["stations"], "station")}; identified by '
        'positions (eq. 10).'
    )


def _quality(record: Record) -> str:
    columns = qualities(record)
    rows = [
        [f'Position error, {key}', *(mm(one['position'][key]) for one in columns.values())]
        for key in ('mean', 'rms', 'max')
    ]
    numbers = range(1, 1 + len(columns))
    text = table('', ['mm', *columns], rows, numbers, name='key-figures')
    turns = [one['orientation'] for one in columns.values()]
    if not any(turns):
        return text
    rows = [
        [f'Turned by, {key}', *(NOTHING if one is None else _degrees(one[key]) for one in turns)]
        for key in ('mean', 'rms', 'max')
    ]
    return text + table('', ['°', *columns], rows, numbers)


def _sure(record: Record) -> str:
    checks = record['diagnostics']
    text = (
        'Standard uncertainty of a position of the first target over the workspace: '
        f'{two_digits(checks["position_uncertainty_rms"])} mm rms, '
        f'{two_digits(checks["position_uncertainty_max"])} mm at most. One point scatters by '
        f'{mm(checks["noise"])} mm (standard deviation per coordinate)'
    )
    if checks['orientation_noise'] is not None:
        text += f', one orientation by {_degrees(checks["orientation_noise"])}° about each axis'
    return paragraph(f'{text}.')


def _targets(record: Record) -> str:
    header = ['target', 'points', 'x, mm', 'y, mm', 'z, mm', 'sure to, mm', 'rotation vector, °']
    rows = [
        [
            one['target'],
            str(one['points']),
            *(mm(value) for value in one['translation']),
            two_digits(max(one['standard_uncertainty'])),
            _vector(one['rotation_vector']),
        ]
        for one in record['targets']
    ]
    return part('Targets on the flange') + table('', header, rows, range(1, 7))


def _stations(record: Record) -> str:
    header = ['station', 'points', 'x, mm', 'y, mm', 'z, mm', 'sure to, mm', 'rotation vector, °']
    rows = [
        [
            str(one['station']),
            str(one['points']),
            *(mm(value) for value in one['translation']),
            two_digits(max(one['standard_uncertainty'])),
            _vector(one['rotation_vector']),
        ]
        for one in record['stations']
    ]
    return part('The arm base in the frame of each station') + table('', header, rows, range(1, 7))


def _vector(values: list[float] | None) -> str:
    return NOTHING if values is None else ', '.join(map(_degrees, values))


def _by(record: Record, what: str) -> str:
    rows = [
        [one['name'], str(one['count']), mm(one['rms']), mm(one['max'])]
        for one in record['diagnostics'][f'by_{what}']
    ]
    header = [what, 'points', 'rms, mm', 'max, mm']
    return part(f'By {what}') + table('', header, rows, range(1, 4), name='narrow')


def _rejected(record: Record) -> str:
    worst = sorted(record['rejected'], key=lambda one: -one['size'])
    if not worst:
        return ''
    rows = [
        [str(one['pose']), one['target'], str(one['station']), mm(one['size']), one['reason']]
        for one in worst[:SHOWN_REJECTED]
    ]
    text = f'{len(worst)} in all' + (', the worst shown.' if len(worst) > len(rows) else '.')
    header = ['point', 'target', 'station', 'off by, mm', 'why']
    return (
        part('Points left out') + paragraph(text) + table('', header, rows, range(4), {4: 'words'})
    )


def point_clouds(done: PointIdentification, held_out: HeldOutPoints | None) -> list[Chart]:
    """Clouds of what the points are away from their predictions."""
    shown: list[tuple[str, str, Array]] = [('after', 'identified', done.identified.position)]
    if held_out is not None:
        shown.insert(0, ('held', 'held out', held_out.identified.position))
    return [_cloud(shown, first, second) for first, second in ((0, 1), (0, 2), (1, 2))]


def _cloud(shown: list[tuple[str, str, Array]], first: int, second: int) -> Chart:
    series = []
    for role, label, values in shown:
        dots = values[thinned(len(values))] * MM
        series.append(Series(dots[:, first], dots[:, second], role, label, fine=True))
    one, other = 'XYZ'[first], 'XYZ'[second]
    return Chart(
        f'residuals_{one.lower()}{other.lower()}',
        f'Residuals in {one} and {other}',
        '',
        f'{one}, mm',
        f'{other}, mm',
        tuple(series),
        shape='square',
        equal=True,
    )


def _degrees(value: float) -> str:
    return f'{value * DEGREE:.5f}'.replace('-', '\u2212')
