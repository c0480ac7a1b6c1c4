# SPDX-License-Identifier: Apache-2.0
"""What a person reads after an identification: before, after and held-out side by side."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from typing import TYPE_CHECKING

from calib_model.errors import LONGEST_LINE
from calib_solver.calibration.calibration import Calibration
from calib_solver.results import (
    Record,
    convention_words,
    left_out_words,
    prior_words,
    resampling_lines,
    scale_words,
)

if TYPE_CHECKING:
    from calib_solver.calibration.points import PointCalibration

ROWS = (
    ('distance error, mean', 'distance', 'mean'),
    ('distance error, max', 'distance', 'max'),
    ('2 sigma, mean', 'two_sigma', 'mean'),
    ('2 sigma, max', 'two_sigma', 'max'),
    ('position error, rms', 'position', 'rms'),
)


def summary_text(calibration: Calibration) -> str:
    """The table in mm, what was not identifiable, warnings first if there are any, the files."""
    done = calibration.done
    lines = list(calibration.notes)
    lines += [f'warning: {warning}' for warning in done.warnings if warning not in lines]
    poses, spheres = len(done.problem.joints), len(done.problem.keys)
    lines.append(
        f'{done.arm.name}: {poses} poses of {spheres} spheres at {len(done.problem.locations)} '
        f'locations, {len(done.fit.x)} of {_parameters(calibration.record)} parameters free'
    )
    lines += table(calibration.record)
    lines += beyond_lines(calibration.record)
    unseen = [
        record['name']
        for record in calibration.record['parameters']
        if record['free'] and not record['identifiable']
    ]
    if unseen:
        lines.append('not told by these poses, kept near nominal: ' + ', '.join(unseen))
    if words := convention_words(calibration.record):
        lines.append(words)
    untold = calibration.record['diagnostics']['untold']
    lines += [f'not told by any such poses: {text}' for text in untold]
    lines += sure_lines(calibration.record)
    lines.append(scale_words(done.problem.measured.gauge))
    if calibration.record['resampling'] is not None:
        lines += resampling_lines(calibration.record['resampling'])
    lines += prior_lines(calibration.record)
    lines.append(calibration.verdict)
    lines += [f'wrote {path}' for path in calibration.written]
    return '\n'.join(lines)


def point_summary_text(calibration: PointCalibration) -> str:
    """The same of a calibration by measured points: targets and stations besides."""
    done, record = calibration.done, calibration.record
    problem, left_out = done.problem, len(done.rejected)
    lines = list(calibration.notes)
    lines += [f'warning: {warning}' for warning in done.warnings]
    lines.append(
        f'{done.arm.name}: {len(problem)} points of {_counted(problem.targets, "target")} from '
        f'{_counted(problem.stations, "station")}, {len(done.fit.x)} of '
        f'{_parameters(record)} parameters free'
        + (f'; {left_out} left out as gross errors, listed under rejected' if left_out else '')
    )
    lines += _point_table(record)
    lines += beyond_lines(record)
    for target in record['targets']:
        x, y, z = (value * 1e3 for value in target['translation'])
        sure = max(target['standard_uncertainty']) * 1e3
        lines.append(
            f'target {target["target"]} on the flange: {x:.3f}, {y:.3f}, {z:.3f} mm, sure to '
            f'{sure:.3f} mm'
        )
    checks = record['diagnostics']
    if record['quality']['left_out'] is not None:
        lines.append(left_out_words(record['quality']['left_out']))
    sure = checks['position_uncertainty_rms']
    lines.append(f'standard uncertainty of a position over the workspace: {sure * 1e3:.4f} mm rms')
    noise = f'a point scatters by {checks["noise"] * 1e3:.4f} mm per coordinate'
    if checks['orientation_noise'] is not None:
        noise += f', an orientation by {checks["orientation_noise"] * 1e3:.4f} mrad'
    lines.append(noise)
    if record['resampling'] is not None:
        lines += resampling_lines(record['resampling'], 'points')
    lines += prior_lines(record)
    lines.append(calibration.verdict)
    lines += [f'wrote {path}' for path in calibration.written]
    return '\n'.join(lines)


def _point_table(record: Record) -> list[str]:
    """Positions in mm and orientations in mrad, before, after and held-out."""
    columns = columns_of(record)
    lines = ['mm, mrad'.ljust(22) + ''.join(name.rjust(18) for name in columns)]
    for group, label in (('position', 'position error'), ('orientation', 'orientation error')):
        if not any(one[group] for one in columns.values()):
            continue
        for key in ('mean', 'rms', 'max'):
            found = (one[group] for one in columns.values())
            cells = ('-' if one is None else f'{one[key] * 1e3:.4f}' for one in found)
            head = f'{label}, {key}'.ljust(22)
            lines.append(head + ''.join(cell.rjust(18) for cell in cells))
    return lines


def _counted(things: Sequence[object], name: str) -> str:
    return f'{len(things)} {name}{"" if len(things) == 1 else "s"}'


def in_one_line(calibration: Calibration | PointCalibration) -> str:
    """How it went, and the warnings behind it, in one line of bounded length."""
    warnings = calibration.record['warnings']
    line = calibration.verdict
    for told, warning in enumerate(warnings):
        longer = f'{line}; warning: {warning}'
        if len(longer) > LONGEST_LINE:
            return f'{line}; and {len(warnings) - told} more in `warnings`'
        line = longer
    return line


def _parameters(record: Record) -> int:
    """How many there are, joint errors included."""
    errors = record['joint_errors']
    return len(record['parameters']) + (len(errors['parameters']) if errors is not None else 0)


def beyond_lines(record: Record) -> list[str]:
    """What became of the joint errors and of eq. 12, where they were asked for."""
    lines: list[str] = []
    if record['joint_errors'] is not None:
        lines += record['joint_errors']['verdict']
        lines += [
            f'  {one["name"]}: {one["reason"]}'
            for one in record['joint_errors']['parameters']
            if one['free'] and not one['identifiable']
        ]
    if record['correction'] is not None:
        lines.append(record['correction']['verdict'])
    return lines


def sure_lines(record: Record) -> list[str]:
    """How sure a position is, and what that rests on."""
    checks, left_out = record['diagnostics'], record['quality']['left_out']
    lines = [left_out_words(left_out)] if left_out is not None else []
    sure = checks['position_uncertainty_rms']
    lines.append(f'standard uncertainty of a position over the workspace: {sure * 1e3:.4f} mm rms')
    noise = f'a pose scatters by {checks["noise"] * 1e3:.4f} mm per coordinate'
    if checks['misfit'] > 1:
        noise += f', locations {sqrt(checks["misfit"]):.2g} times as much as that explains'
    return [*lines, noise]


def prior_lines(record: Record) -> list[str]:
    """What widths came out where these were left to the evidence."""
    return [prior_words(record)] if record['diagnostics']['prior']['widths'] else []


def table(record: Record) -> list[str]:
    """Lines of a table of a result's qualities in mm, one column each."""
    columns = columns_of(record)
    lines = ['mm'.ljust(22) + ''.join(name.rjust(18) for name in columns)]
    for label, group, key in ROWS:
        values = [each[group][key] for each in columns.values()]
        cells = ['-' if value is None else f'{value * 1e3:.4f}' for value in values]
        lines.append(label.ljust(22) + ''.join(cell.rjust(18) for cell in cells))
    return lines


def columns_of(record: Record) -> dict[str, Record]:
    """A result's qualities by name, those with eq. 12's correction where it was accepted."""
    quality, correction = record['quality'], record['correction']
    corrected = (correction or {}).get('quality') or {}
    columns = {
        'initial': quality['initial'],
        'identified': quality['identified'],
        'held-out initial': quality['test_initial'],
        'held-out': quality['test'],
        'corrected': corrected.get('identified'),
        'held-out corr.': corrected.get('test'),
    }
    return {name: each for name, each in columns.items() if each is not None}
