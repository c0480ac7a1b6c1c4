# SPDX-License-Identifier: Apache-2.0
"""The report's account of what goes beyond Denavit-Hartenberg: joint errors and eq. 12."""

from __future__ import annotations

from calib_solver.report.html import mm, paragraph, part, section, table
from calib_solver.report.parameters import parameter_tables
from calib_solver.results import Record

JUDGED = (
    'Judged on gauge locations left out in turn ({folds} parts): the change of their rms, with the '
    'standard error of its logarithm; what does not help there is not used.'
)


def beyond(record: Record) -> str:
    """What became of joint errors and of eq. 12, where they were asked for or found; else
    nothing."""
    errors, correction = record.get('joint_errors'), record.get('correction')
    parts = []
    if errors is not None and errors['verdict']:
        parts.append(_joint_errors(errors))
    if correction is not None:
        parts.append(_correction(correction))
    return section('Beyond Denavit-Hartenberg', *parts) if parts else ''


def _joint_errors(errors: Record) -> str:
    rows = [
        [one['kind'], 'used' if one['identified'] else 'refused', *_gain(one)]
        for one in errors['tried']
    ]
    header = ['kind', '', 'change', 'std. error', 'rms without, mm', 'rms with, mm']
    text = part('Joint errors') + ''.join(map(paragraph, errors['verdict']))
    if rows:
        text += paragraph(JUDGED.format(folds=errors['folds']))
        text += table('', header, rows, range(2, 6))
    if errors['parameters']:
        text += ''.join(parameter_tables(errors['parameters']))
    return text


def _gain(one: Record) -> list[str]:
    change = f'{100 * one["change"]:+.1f} %'.replace('-', '\u2212')
    rms = (mm(one['rms_before']), mm(one['rms_after']))
    return [change, f'{one["standard_error"]:.3f}', *rms]


def _correction(correction: Record) -> str:
    text = part('Correction functions (eq. 12)') + paragraph(correction['verdict'])
    gain = correction['gain']
    if gain is None:
        return text
    rows = [
        ['all residuals, rms', mm(gain['rms_before']), mm(gain['rms_after'])],
        ['2 sigma, rms', mm(gain['two_sigma_before']), mm(gain['two_sigma_after'])],
        ['distance error, rms', mm(gain['distance_before']), mm(gain['distance_after'])],
    ]
    basis = (
        f'Harmonics of the joints\u2019 angles: {correction["turn_harmonics"]} in what turns with '
        f'a joint, {correction["shift_harmonics"]} in each coordinate; held with strength '
        f'{correction["strength"]:g}.'
    )
    header = ['left out, mm', 'without', 'with correction']
    return (
        text
        + paragraph(basis)
        + paragraph(JUDGED.format(folds=correction['folds']))
        + table('', header, rows, (1, 2), name='narrow')
    )
