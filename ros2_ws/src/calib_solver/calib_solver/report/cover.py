# SPDX-License-Identifier: Apache-2.0
"""The report's first page: who measured what with what, the verdict, three figures, one chart."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Any

from markupsafe import Markup

from calib_solver.report.evidence import charts_of
from calib_solver.report.html import (
    DEGREE,
    counted,
    facts,
    mm,
    number,
    rendered,
    side_by_side,
    table,
    two_digits,
    warnings_box,
)
from calib_solver.report.residuals import warnings
from calib_solver.results import LEFT_OUT_WORDS, Info, Judged, Record, judge

#: of three coordinates alike 95 % are within so many times their rms together
COVERAGE = 1.614
#: warnings that have room on the first page; the others follow on the second
SHOWN = 3


def cover(record: Record, evidence: dict[str, Any], info: Info) -> str:
    """The first page; `evidence` is what `evidence_of` says."""
    judged = judge(info.limits, judged_quality(record), record['arm']) if info.limits else []
    shown = charts_of(evidence, 'residuals' if 'stations' in record else 'quality')[:1]
    return rendered(
        'cover',
        number=info.number,
        title=f'Kinematic calibration of {record["arm"]}',
        marks=_marks(record, evidence),
        warnings=Markup(warnings_box(warnings(record)[:SHOWN])),
        facts=Markup(facts(_facts(record, evidence, info))),
        verdict=_verdict(judged, record),
        passed=all(one.passed for one in judged),
        limits=Markup(_limits(judged)) if judged else '',
        figures=_figures(record),
        chart=Markup(side_by_side(shown)),
        notes=info.notes,
        operator=info.operator,
    )


def judged_quality(record: Record) -> Record:
    """What the limits are held against: the held-out poses, where there are any."""
    quality: Record = record['quality']
    corrected = (record.get('correction') or {}).get('quality') or {}
    if quality['test'] is not None:
        return corrected.get('test') or quality['test']
    return corrected.get('identified') or quality['identified']


def _marks(record: Record, evidence: dict[str, Any]) -> list[str]:
    """What nobody may overlook."""
    lines = []
    if evidence['simulated']:
        lines.append('Simulated: no real arm was measured.')
    if record['quality']['test'] is None:
        lines.append(
            f'Nothing was held out: the figures are those of the {_taken(record)} it was made from.'
        )
    return lines


def _facts(record: Record, evidence: dict[str, Any], info: Info) -> list[tuple[str, str]]:
    readings = record.get('readings') or {'first': None, 'last': None}
    scale, used = record['diagnostics']['scale'], _instruments(record, evidence)
    warmth = info.temperature if info.temperature is not None else (scale or {}).get('temperature')
    rows = [
        ('Readings', days(readings) or 'no date'),
        ('Report', day(datetime.now(timezone.utc).isoformat())),
        *((of.capitalize(), _with_serial(name, info, of)) for of, name in used.items()),
        ('Temperature', 'not recorded' if warmth is None else f'{warmth:g} °C'),
        ('Operator', info.operator or 'not recorded'),
    ]
    others = [(name, text) for name, text in info.serials.items() if name not in used]
    rows[2 + len(used) : 2 + len(used)] = [(name, f'serial {text}') for name, text in others]
    return [*rows, ('Organisation', info.organisation)] if info.organisation else rows


def _instruments(record: Record, evidence: dict[str, Any]) -> dict[str, str]:
    """What each is called."""
    if 'stations' not in record:
        return {'arm': record['arm'], 'probe': evidence['probe'], 'gauge': evidence['gauge']}
    targets, stations = (counted(evidence[f'{of}s'], of) for of in ('target', 'station'))
    return {'arm': record['arm'], 'target': targets, 'tracker': stations}


def _taken(record: Record) -> str:
    return 'points' if 'stations' in record else 'poses'


def _with_serial(name: str, info: Info, of: str) -> str:
    serial = info.serials.get(of)
    return f'{name}, serial {serial}' if serial else f'{name}, serial not recorded'


def day(moment: str | None) -> str:
    """The day of an ISO 8601 time, as all dates of the report are."""
    return moment[:10] if moment else ''


def days(readings: Record) -> str:
    """The days of the `first` and the `last` reading; nothing where they have no date."""
    first, last = day(readings['first']), day(readings['last'])
    return first if first == last else f'{first} to {last}'


def _verdict(judged: list[Judged], record: Record) -> str:
    if not judged:
        return ''
    kept = sum(one.passed for one in judged)
    taken = _taken(record)
    held_out = record['quality']['test'] is not None
    by = f'held-out {taken}' if held_out else f'the {taken} it was made from'
    word = 'Passed' if kept == len(judged) else 'Failed'
    return f'{word}: {kept} of {len(judged)} limits kept, judged on {by}.'


def _limits(judged: list[Judged]) -> str:
    rows = [
        [one.name, mm(one.value), mm(one.limit), 'passed' if one.passed else 'failed']
        for one in judged
    ]
    return table('', ['limit', 'value, mm', 'allowed, mm', ''], rows, (1, 2))


def _figures(record: Record) -> list[dict[str, str]]:
    """The three figures that people ask for."""
    left_out, quality = record['quality']['left_out'], judged_quality(record)
    held = 'held out' if record['quality']['test'] is not None else 'not held out'
    if left_out is None:
        expected = {'value': 'not judged', 'more': 'nothing was left out in turn'}
    else:
        size = max(left_out['position']['rms'], left_out['position']['stated'])
        where = LEFT_OUT_WORDS[left_out['by']][0]
        expected = {
            'value': f'{two_digits(COVERAGE * size)} mm',
            'more': f'95 % of positions, {COVERAGE:.2f} times {mm(size)} mm rms, {where}',
        }
    expected = {'label': 'Expected error', **expected}
    if 'stations' in record:
        return [expected, *_point_figures(quality, held)]
    return [
        expected,
        {
            'label': f'Distances, {held}',
            'value': f'{mm(quality["distance"]["max"])} mm',
            'more': f'largest error; mean {mm(quality["distance"]["mean"])} mm',
        },
        {
            'label': f'2 sigma, {held}',
            'value': f'{mm(quality["two_sigma"]["max"])} mm',
            'more': f'largest of a coordinate; mean {mm(quality["two_sigma"]["mean"])} mm',
        },
    ]


def _point_figures(quality: Record, held: str) -> list[dict[str, str]]:
    """The figures of measured points: how far off, and how far turned where that was measured."""
    found = [
        {
            'label': f'Positions, {held}',
            'value': f'{mm(quality["position"]["max"])} mm',
            'more': f'largest error; rms {mm(quality["position"]["rms"])} mm',
        }
    ]
    turned = quality['orientation']
    if turned is not None:
        largest, rms = (number(turned[key] * DEGREE, 4) for key in ('max', 'rms'))
        more = f'largest error; rms {rms} °'
        found.append({'label': f'Orientations, {held}', 'value': f'{largest} °', 'more': more})
    return found
