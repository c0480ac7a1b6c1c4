# SPDX-License-Identifier: Apache-2.0
"""The report's tables of quality: the chapter's Fig. 6, and the arm as a measuring arm."""

from __future__ import annotations

from calib_solver.report.html import NOTHING, mm, paragraph, table
from calib_solver.results import Record

#: columns by name
Columns = dict[str, Record]


def qualities(record: Record) -> Columns:
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


def key_figures(columns: Columns) -> str:
    """The four figures that people ask for first."""
    rows = [
        [f'{label}, {key}', *(mm(q[group][key]) for q in columns.values())]
        for group, label in (('distance', 'Distance error'), ('two_sigma', '2 sigma'))
        for key in ('mean', 'max')
    ]
    header = ['mm', *columns]
    return table('', header, rows, range(1, 1 + len(columns)), name='key-figures')


def full_quality(columns: Columns) -> str:
    """Every figure of Fig. 6 with what causes it."""
    records = list(columns.values())
    rows: list[list[str]] = [['Distance errors']]
    rows += _extremes(records, 'distance', 'distance error', ('max', 'min'))
    rows += [_row(records, 'distance', key, f'distance error, {key}') for key in ('mean', 'rms')]
    rows.append(['2 sigma by sphere'])
    rows += _extremes(records, 'two_sigma', '2 sigma', ('max', 'min'))
    rows.append(_row(records, 'two_sigma', 'mean', '2 sigma, mean'))
    for axis, name in enumerate('XYZ'):
        means = (mm(r['two_sigma']['mean_xyz'][axis]) for r in records)
        rows.append([f'2 sigma, mean {name}', *means])
    rows.append(['Distance to the certificate after a best fit of each location'])
    rows += [
        _row(records, 'position', key, f'position error, {key}') for key in ('max', 'mean', 'rms')
    ]
    numbers = range(1, 1 + len(columns))
    sums = [['phi of eq. 11', *(f'{r["phi"] * 1e6:.4g}' for r in records)]]
    counts = [['distances', *(str(r['distance']['count']) for r in records)]]
    return (
        table('', ['mm', *columns], rows, numbers)
        + table('', ['mm²', *columns], sums, numbers)
        + table('', ['number of', *columns], counts, numbers)
    )


def _row(records: list[Record], group: str, key: str, label: str) -> list[str]:
    return [label, *(mm(record[group][key]) for record in records)]


def _extremes(
    records: list[Record], group: str, label: str, ends: tuple[str, ...]
) -> list[list[str]]:
    rows = []
    for end in ends:
        rows.append(_row(records, group, end, f'{label}, {end}'))
        rows.append([f'caused at ({end})', *(_place(r[group], end) for r in records)])
    return rows


def _place(record: Record, end: str) -> str:
    """Location and distance, or location, sphere and coordinate, as the chapter's tables do."""
    if record[end] is None:
        return NOTHING
    location = f'location {record[f"{end}_location"]}'
    if f'{end}_pair' in record:
        return f'{location}, {_pair(record[f"{end}_pair"])}'
    coordinate = record[f'{end}_coordinate'].upper()
    return f'{location}, B{record[f"{end}_sphere"]}, {coordinate}'


def _pair(spheres: list[int]) -> str:
    return f'D{spheres[0]}\u2011{spheres[1]}'  # a hyphen that is not broken after


def measuring_arm(columns: Columns) -> str:
    """ASME B89.4.22's quantities with how they were computed."""
    arms = [record['measuring_arm'] for record in columns.values()]
    points, lengths = ([arm[key] for arm in arms] for key in ('single_point', 'length'))
    rows = [
        ['Single-point articulation'],
        ['deviation from the seat\u2019s mean, max', *_mm_of(points, 'max_deviation')],
        ['caused at (max)', *(_seat(one, 'max') for one in points)],
        ['2 s, largest of a seat', *_mm_of(points, 'two_s_max')],
        ['caused at (2 s)', *(_seat(one, 'two_s') for one in points)],
        ['2 s, mean of all seats', *_mm_of(points, 'two_s_mean')],
        ['Volumetric lengths'],
        ['length deviation, max', *_mm_of(lengths, 'max_deviation')],
        ['caused at (length)', *(_length(one) for one in lengths)],
        ['certified length there', *_mm_of(lengths, 'max_length')],
        ['2 RMS', *_mm_of(lengths, 'two_rms')],
        ['length deviation, mean', *_mm_of(lengths, 'mean')],
        ['range', *_mm_of(lengths, 'span')],
    ]
    counts = [
        ['seats', *_count_of(points, 'spheres')],
        ['points', *_count_of(points, 'points')],
        ['lengths', *_count_of(lengths, 'count')],
    ]
    numbers = range(1, 1 + len(columns))
    return (
        paragraph(
            f'The quantities in which ASME B89.4.22-2004 states a measuring arm, '
            f'{arms[0]["basis"]}: a probed sphere stands for the seat, two spheres of the gauge '
            'for the length. No limits are set here.'
        )
        + table('', ['mm', *columns], rows, numbers)
        + table('', ['number of', *columns], counts, numbers)
        + paragraph(
            '2 s = 2 √(Σ δ² / (n − 1)) with δ the distance in space of each of the n points on a '
            'seat from their mean. A length is measured between a single point on either sphere '
            '(the k-th of one, the k-th of the other); its deviation is measured minus certified, '
            '2 RMS is twice the root mean square of the deviations, the range goes from the '
            'smallest to the largest.',
            'says',
        )
    )


def standards(columns: Columns) -> str:
    """Quantities of ISO 10360-12 and ISO 9283 with what they are here."""
    found = [record['standards'] for record in columns.values()]

    def place(end: str) -> list[str]:
        return [
            NOTHING
            if one[end] is None
            else f'location {one[f"{end}_location"]}, B{one[f"{end}_sphere"]}'
            for one in found
        ]

    rows = [
        ['ISO 10360-12'],
        ['location error L Dia, max', *_mm_of(found, 'location_error')],
        ['caused at (L Dia)', *place('location_error')],
        ['location error L Dia, mean', *_mm_of(found, 'location_error_mean')],
        ['length error E, max', *_mm_of(found, 'length_error')],
        ['ISO 9283'],
        ['pose accuracy AP, max', *_mm_of(found, 'pose_accuracy')],
        ['caused at (AP)', *place('pose_accuracy')],
        ['pose repeatability RP, max', *_mm_of(found, 'pose_repeatability')],
        ['caused at (RP)', *place('pose_repeatability')],
        ['distance accuracy AD, max', *_mm_of(found, 'distance_accuracy')],
        ['distance repeatability RD, max', *_mm_of(found, 'distance_repeatability')],
    ]
    return (
        paragraph(
            f'Quantities {found[0]["basis"]}: these prescribe artefacts, places, points, speed and '
            'load. No limits are set here.'
        )
        + table('', ['mm', *columns], rows, range(1, 1 + len(columns)))
        + paragraph(
            'L Dia is the diameter of the smallest sphere around the centres that the poses of one '
            'sphere give, each an articulation of its own. E is the deviation, measured minus '
            'certified, of lengths between single poses of two spheres, probed from either side '
            'alike (unidirectional). AP is the distance of the mean of a sphere\u2019s poses from '
            'the certificate as placed at its location, RP = l + 3 s with l and s the mean and the '
            'standard deviation of the poses\u2019 distances from their mean; the poses differ in '
            'posture, where the standard repeats one. AD is the deviation of the mean of single '
            'distances from the certificate, RD three times their standard deviation.',
            'says',
        )
    )


def _mm_of(records: list[Record | None], key: str) -> list[str]:
    return [NOTHING if record is None else mm(record[key]) for record in records]


def _seat(record: Record | None, end: str) -> str:
    if record is None:
        return NOTHING
    return f'location {record[f"{end}_location"]}, B{record[f"{end}_sphere"]}'


def _count_of(records: list[Record | None], key: str) -> list[str]:
    return [NOTHING if record is None else str(record[key]) for record in records]


def _length(record: Record | None) -> str:
    if record is None:
        return NOTHING
    return f'location {record["max_location"]}, {_pair(record["max_pair"])}'
