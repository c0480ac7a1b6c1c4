# SPDX-License-Identifier: Apache-2.0
"""The report's tables of parameters: corrections, how sure they are, and what tells them; and of
what goes beyond Denavit-Hartenberg: joint errors and eq. 12."""

from __future__ import annotations

from calib_solver.report.html import (
    DEGREE,
    MM,
    NOTHING,
    UNITS,
    decimals_of,
    mm,
    number,
    paragraph,
    part,
    section,
    table,
    two_digits,
)
from calib_solver.results import Record, convention_words

JUDGED = (
    'Judged on {left_out} left out in turn ({folds} parts): the change of their rms, with the '
    'standard error of its logarithm; what does not help there is not used.'
)
METHODS = {'monte_carlo': 'Monte Carlo', 'bootstrap': 'bootstrap over'}


def parameters(record: Record) -> str:
    """Every parameter before and after: lengths in mm and angles in degrees, each their table."""
    count = sum(parameter['free'] for parameter in record['parameters'])
    told = sum(parameter['identifiable'] for parameter in record['parameters'])
    text = paragraph(
        f'{count} of {len(record["parameters"])} parameters were free, {told} of them are told by '
        'the poses. Held ones say why. Uncertainties are standard uncertainties (k = 1), to two '
        'digits.'
    )
    words = convention_words(record)
    convention = paragraph(words) if words else ''
    return convention + text + ''.join(parameter_tables(record['parameters']))


def parameter_tables(parameters: list[Record]) -> list[str]:
    """A table of parameters for each unit that they have."""
    found = []
    for kind in dict.fromkeys(parameter['unit'] for parameter in parameters):
        unit = UNITS[kind][1]
        header = [
            f'parameter, {unit}',
            'initial',
            'identified',
            'correction',
            'std. uncertainty',
            'what tells it',
        ]
        rows = [parameter_row(one) for one in parameters if one['unit'] == kind]
        found.append(table('', header, rows, range(1, 5), {5: 'words'}))
    return found


def parameter_row(parameter: Record) -> list[str]:
    """Before, after, correction, uncertainty to two digits and reason of a parameter."""
    factor, _ = UNITS[parameter['unit']]
    before, after = parameter['initial'] * factor, parameter['identified'] * factor
    sure = parameter['standard_uncertainty']
    decimals = 5 if sure is None else decimals_of(sure * factor)
    return [
        parameter['name'],
        number(before, decimals),
        number(after, decimals),
        number(after - before, decimals, '+') if parameter['free'] else 'held',
        NOTHING if sure is None else number(sure * factor, decimals),
        parameter['reason'],
    ]


def mount(record: Record) -> str:
    """The probe's place on the flange, and eq. 15's account of itself."""
    placed, fit = record['flange_T_probe'], record['probe_fit']
    rows = [
        [axis, number(along * MM, 4), number(about * DEGREE, 4)]
        for axis, along, about in zip(
            'xyz', placed['translation'], placed['rotation_vector'], strict=True
        )
    ]
    header = ['flange to probe (P of eq. 14)', 'translation, mm', 'rotation vector, °']
    text = table('', header, rows, (1, 2), name='narrow')
    if fit is None:
        return text
    return text + paragraph(
        f'Eq. 15, from {fit["poses"]} poses of {fit["spheres"]} spheres, gave the start: residual '
        f'{mm(fit["residual_rms"])} mm rms, orthogonality error '
        f'{fit["orthogonality_error"]:.2g}, condition {fit["condition"]:.3g}.'
    )


def repetitions(record: Record) -> str:
    """What repeated identifications say of the stated uncertainties, where they were made."""
    found = record['resampling']
    if found is None:
        return ''
    made = {method: name for method, name in METHODS.items() if found[method] is not None}
    if 'bootstrap' in made:
        made['bootstrap'] += ' points' if 'targets' in record else ' locations'
    text = part('Repetitions')
    for method, name in made.items():
        text += paragraph(_repeated(name, found[method], found['seed']))
    for kind in dict.fromkeys(parameter['unit'] for parameter in found['parameters']):
        factor, unit = UNITS[kind]
        rows = []
        for parameter in found['parameters']:
            if parameter['unit'] == kind:
                sizes = [parameter[key] for key in ('analytic', *made)]
                rows.append([parameter['name'], *(two_digits(size, factor) for size in sizes)])
        header = [f'std. uncertainty, {unit}', 'stated', *made.values()]
        text += table('', header, rows, range(1, 2 + len(made)))
    return text


def _repeated(name: str, found: Record, seed: int) -> str:
    text = (
        f'{name[0].upper()}{name[1:]}: {found["repetitions"]} repetitions (seed {seed}), '
        f'{found["converged"]} converged; standard uncertainty of a position over the workspace '
        f'{two_digits(found["position_uncertainty_rms"])} mm rms.'
    )
    if found['ratio_to_analytic'] is not None:
        ratio = found['ratio_to_analytic']
        text += f' Parameters are {ratio:.2f} times as unsure as stated (median).'
    return text


def beyond(record: Record) -> str:
    """What became of joint errors and of eq. 12, where they were asked for or found; else
    nothing."""
    errors, correction = record.get('joint_errors'), record.get('correction')
    parts, left_out = [], 'groups of points' if 'stations' in record else 'gauge locations'
    if errors is not None and errors['verdict']:
        parts.append(_joint_errors(errors, left_out))
    if correction is not None:
        parts.append(_correction(correction, left_out))
    return section('Beyond Denavit-Hartenberg', *parts) if parts else ''


def _joint_errors(errors: Record, left_out: str) -> str:
    rows = [
        [one['kind'], 'used' if one['identified'] else 'refused', *_gain(one)]
        for one in errors['tried']
    ]
    header = ['kind', '', 'change', 'std. error', 'rms without, mm', 'rms with, mm']
    text = part('Joint errors') + ''.join(map(paragraph, errors['verdict']))
    if rows:
        text += paragraph(JUDGED.format(left_out=left_out, folds=errors['folds']))
        text += table('', header, rows, range(2, 6))
    if errors['parameters']:
        text += ''.join(parameter_tables(errors['parameters']))
    return text


def _gain(one: Record) -> list[str]:
    change = f'{100 * one["change"]:+.1f} %'.replace('-', '\u2212')
    rms = (mm(one['rms_before']), mm(one['rms_after']))
    return [change, f'{one["standard_error"]:.3f}', *rms]


def _correction(correction: Record, left_out: str) -> str:
    text = part('Correction functions (eq. 12)') + paragraph(correction['verdict'])
    gain = correction['gain']
    if gain is None:
        return text
    named = {
        'all residuals, rms': 'rms',
        '2 sigma, rms': 'two_sigma',
        'distance error, rms': 'distance',
    }
    rows = [
        [name, mm(gain[f'{key}_before']), mm(gain[f'{key}_after'])]
        for name, key in named.items()
        if gain[f'{key}_before'] is not None
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
        + paragraph(JUDGED.format(left_out=left_out, folds=correction['folds']))
        + table('', header, rows, (1, 2), name='narrow')
    )
