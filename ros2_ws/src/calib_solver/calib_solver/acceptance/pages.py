# SPDX-License-Identifier: Apache-2.0
"""`verification.html` and `comparison.html`: a verdict on one page, with pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.files import write_whole
from calib_solver import report
from calib_solver.acceptance.history import History, Step, step_lines
from calib_solver.acceptance.point_verification import PointVerification
from calib_solver.acceptance.verification import Verification, verification_lines
from calib_solver.report import Band, Chart, Series

#: mm: keeps a perfect value on a logarithmic axis
LEAST = 1e-7
GROUPS = (
    ('distance error, max', 'distance', 'max'),
    ('distance error, mean', 'distance', 'mean'),
    ('2 sigma, max', 'two_sigma', 'max'),
    ('2 sigma, mean', 'two_sigma', 'mean'),
    ('position error, max', 'position', 'max'),
    ('position error, rms', 'position', 'rms'),
)

#: a chart's name and its title
POSITION, DISTANCE = ('position', 'Position errors'), ('distance', 'Distance errors')


def write_verification(found: Verification | PointVerification, folder: str) -> Path:
    """Write `verification.html` to a folder.

    Raises:
        CalibrationError: it cannot be written.
    """
    record = found.record()
    title = f'Verification of {found.result.arm.name}: {found.verdict}'
    when = _when(record['readings'])
    limits = [
        [one.name, report.mm(one.value), report.mm(one.limit), 'passed' if one.passed else 'failed']
        for one in found.limits
    ]
    stated = [
        [
            f'{name} error, rms',
            report.mm(one.rms),
            report.two_digits(one.stated),
            report.mm(one.bound),
            'within' if one.within else 'beyond',
        ]
        for name, one in (('position', found.position), ('distance', found.distance))
        if one is not None
    ]
    quality = [
        [label, report.mm(record['nominal'][group][key]), report.mm(record['quality'][group][key])]
        for label, group, key in GROUPS
        if record['quality'][group] is not None
    ]
    charts = (
        [_point_chart(found)]
        if isinstance(found, PointVerification)
        else _verification_charts(found)
    )
    sections = [
        f'<header><p class="kind">Verification</p>{report.heading(title)}',
        report.paragraph(f'The calibration in {found.result.folder} on new poses{when}.', 'faint'),
        report.verdict_box(found.verdict, verification_lines(found)[-1]),
        '</header>',
        report.section(
            'Limits', report.table('', ['limit', 'value, mm', 'allowed, mm', ''], limits, (1, 2))
        )
        if limits
        else '',
        report.section(
            'Against what the calibration states',
            report.paragraph(
                'Errors on the new poses, what the calibration states for them with the '
                'uncertainty of its parameters, of what they were held against and of single '
                'poses, and the bound that both keep to in 95 of 100 cases.'
            ),
            report.table('', ['', 'found, mm', 'stated, mm', 'bound, mm', ''], stated, (1, 2, 3)),
        ),
        report.section(
            'Figures', report.table('', ['mm', 'nominal', 'calibrated'], quality, (1, 2))
        ),
        report.section('Pose by pose', report.side_by_side(charts)),
    ]
    return _written(folder, 'verification.html', report.document(title, sections))


def _verification_charts(found: Verification) -> list[Chart]:
    problem, keys = found.problem, found.problem.keys
    of_pose = np.repeat(np.arange(len(keys)), problem.counts)
    names = _pose_names(found, of_pose)
    charts = [
        _errors_chart(
            POSITION,
            'Distance of each pose to the certificate as placed, by location.',
            'location, each with its poses',
            _before_and_after(found.nominal.position, found.quality.position, names),
            keys[of_pose, 0],
        )
    ]
    if len(problem.pairs):
        pairs = tuple(
            f'location {keys[a, 0]}, B{keys[a, 1]} to B{keys[b, 1]}' for a, b in problem.pairs
        )
        charts.append(
            _errors_chart(
                DISTANCE,
                'Of each pair of spheres, by location.',
                'location, each with its pairs of spheres',
                _before_and_after(found.nominal.distance, found.quality.distance, pairs),
                keys[problem.pairs[:, 0], 0],
            )
        )
    return charts


def _point_chart(found: PointVerification) -> Chart:
    problem = found.problem
    names = tuple(
        f'point {place}, target {problem.targets[target]}, station {problem.stations[station]}'
        for place, target, station in zip(
            problem.order, problem.target, problem.station, strict=True
        )
    )
    return _errors_chart(
        POSITION,
        'Distance of each measured point to where it is predicted, by station.',
        'station, each with its points',
        _before_and_after(found.nominal.distance, found.quality.distance, names),
        np.array(problem.stations)[problem.station],
    )


def _errors_chart(
    of: tuple[str, str], about: str, axis: str, series: tuple[Series, ...], where: Array
) -> Chart:
    """Errors one beside the next, in bands of where (N,) they were found."""
    name, title = of
    return Chart(name, title, about, axis, 'mm', series, logarithmic=True, bands=_bands(where))


def _before_and_after(
    nominal: Array, calibrated: Array, names: tuple[str, ...]
) -> tuple[Series, ...]:
    """Errors (N,), m, one beside the next, by the nominal arm and by the calibration."""
    order: Array = np.arange(len(nominal), dtype=np.float64) + 0.5
    return (
        Series(order, _mm(nominal), 'before', 'nominal', names=names),
        Series(order, _mm(calibrated), 'after', 'calibrated', names=names),
    )


def _pose_names(found: Verification, of_pose: Array) -> tuple[str, ...]:
    keys = found.problem.keys
    return tuple(
        f'pose {pose}, location {keys[row, 0]}, B{keys[row, 1]}'
        for pose, row in zip(found.problem.order, of_pose, strict=True)
    )


def _bands(location: Array) -> tuple[Band, ...]:
    """The stretches of rows (R,) that belong to one location each."""
    changes = np.flatnonzero(np.diff(location)) + 1
    ends = [0, *changes.tolist(), len(location)]
    return tuple(
        Band(float(begin), float(end), str(location[begin]))
        for begin, end in zip(ends[:-1], ends[1:], strict=True)
    )


def _mm(values: Array) -> Array:
    return np.maximum(np.abs(values) * 1e3, LEAST)


def _when(readings: dict[str, str | None]) -> str:
    taken = report.days(readings)
    return f', readings of {taken}' if taken else ''


def write_comparison(found: History, folder: str) -> Path:
    """Write `comparison.html` to a folder.

    Raises:
        CalibrationError: it cannot be written.
    """
    name = found.results[0].arm.name
    title = f'{name}: {found.verdict.partition(":")[0]}'
    rows = [[one.date or 'no date', one.folder] for one in found.results]
    sections = [
        f'<header><p class="kind">Comparison of calibrations</p>{report.heading(title)}',
        report.verdict_box('passed' if not _changed(found) else 'changed', found.verdict),
        '</header>',
        report.section('In order', report.table('', ['last reading', 'result'], rows)),
        *(report.paragraph(note) for note in found.notes),
        *(_step_section(step) for step in found.steps),
    ]
    return _written(folder, 'comparison.html', report.document(title, sections))


def _changed(found: History) -> bool:
    return any(step.changed for step in found.steps)


def _step_section(step: Step) -> str:
    return report.section(
        f'From {step.earlier.folder} to {step.later.folder}',
        *(report.paragraph(line.strip()) for line in step_lines(step)),
        report.side_by_side(_step_charts(step)),
        *_change_tables(step.record()['parameters']),
    )


def _change_tables(parameters: list[dict[str, Any]]) -> list[str]:
    """A table of changes for each unit that the parameters have."""
    found = []
    for kind in dict.fromkeys(one['unit'] for one in parameters):
        factor, unit = report.UNITS[kind]
        rows = []
        for one in (each for each in parameters if each['unit'] == kind):
            sure = one['standard_uncertainty']
            decimals = report.decimals_of(sure * factor)
            change = report.number(one['difference'] * factor, decimals, '+')
            beyond = 'beyond' if one['beyond'] else ''
            rows.append([one['name'], change, report.two_digits(sure, factor), beyond])
        header = [f'parameter, {unit}', 'later less earlier', 'joint std. uncertainty', '']
        found.append(report.table('', header, rows, (1, 2)))
    return found


def _step_charts(step: Step) -> list[Chart]:
    there, found = step.positions, step.compared
    radius = np.hypot(there.points[:, 0], there.points[:, 1])
    size = there.size * 1e3
    names = tuple(
        f'{one:.4f} mm, joint standard uncertainty {sure * 1e3:.4f} mm'
        for one, sure in zip(size, there.standard, strict=True)
    )
    beyond = there.beyond & step.arm_changed
    parts = [
        ('before', 'by chance', ~beyond),
        ('held', 'beyond uncertainty', beyond),
    ]
    place = Chart(
        'positions',
        'Where the arm is elsewhere',
        'Postures drawn over the workspace, by their distance from axis 1 and their height.',
        'distance from axis 1, m',
        'Z, m',
        tuple(
            Series(radius[own], there.points[own, 2], role, label, names=_taken(names, own))
            for role, label, own in parts
            if own.any()
        ),
        shape='view',
        equal=True,
    )
    ratio = found.size / np.maximum(found.standard, 1e-300)
    order: Array = np.arange(len(ratio), dtype=np.float64) + 0.5
    parameters = Chart(
        'parameters',
        'Change over its uncertainty',
        'Each parameter, later less earlier, over the joint standard uncertainty of that.',
        'parameter',
        'standard uncertainties',
        (Series(order, ratio, 'after', names=found.names),),
        shape='view',
        bands=tuple(Band(float(i), i + 1.0, name) for i, name in enumerate(found.names)),
    )
    sizes = Chart(
        'sizes',
        'Size of the change',
        'At each of these postures, against the joint standard uncertainty there.',
        'joint standard uncertainty, mm',
        'change, mm',
        (Series(there.standard * 1e3, size, 'after', names=names, fine=True),),
        shape='view',
    )
    return [place, sizes, parameters]


def _taken(names: tuple[str, ...], rows: NDArray[np.bool_]) -> tuple[str, ...]:
    return tuple(name for name, own in zip(names, rows, strict=True) if own)


def _written(folder: str, name: str, text: str) -> Path:
    path = Path(folder) / name
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode('utf-8', 'backslashreplace'))
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be written: {error.strerror}') from error
    return path
