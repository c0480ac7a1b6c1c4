# SPDX-License-Identifier: Apache-2.0
"""The report's tables of parameters: corrections, how sure they are, and what tells them."""

from __future__ import annotations

from calib_solver.report.html import DEGREE, MM, NOTHING, UNITS, mm, paragraph, part, table
from calib_solver.results import Record, convention_words

METHODS = {'monte_carlo': 'Monte Carlo', 'bootstrap': 'bootstrap over locations'}


def parameters(record: Record) -> str:
    """Every parameter before and after, lengths in mm and angles in degrees."""
    rows = [parameter_row(parameter) for parameter in record['parameters']]
    header = [
        'parameter',
        'initial',
        'identified',
        'correction',
        'std. uncertainty',
        'unit',
        'what tells it',
    ]
    count = sum(parameter['free'] for parameter in record['parameters'])
    told = sum(parameter['identifiable'] for parameter in record['parameters'])
    told_of = paragraph(
        f'{count} of {len(record["parameters"])} parameters were free, {told} of them are told by '
        'the poses. Held ones say why. Uncertainties are standard uncertainties (k = 1).'
    )
    words = convention_words(record)
    convention = paragraph(words) if words else ''
    return convention + told_of + table('', header, rows, range(1, 5), {6: 'words'})


def parameter_row(parameter: Record) -> list[str]:
    """Before, after, correction, uncertainty, unit and reason of a parameter."""
    factor, unit = UNITS[parameter['unit']]
    before, after = parameter['initial'] * factor, parameter['identified'] * factor
    sure = parameter['standard_uncertainty']
    return [
        parameter['name'],
        _signed(f'{before:.5f}'),
        _signed(f'{after:.5f}'),
        _signed(f'{after - before:+.5f}') if parameter['free'] else 'held',
        NOTHING if sure is None else f'{sure * factor:.5f}',
        unit,
        parameter['reason'],
    ]


def _signed(number: str) -> str:
    return number.replace('-', '\u2212')


def mount(record: Record) -> str:
    """The probe's place on the flange, and eq. 15's account of itself."""
    placed, fit = record['flange_T_probe'], record['probe_fit']
    rows = [
        ['translation, mm', *(_signed(f'{value * MM:.4f}') for value in placed['translation'])],
        [
            'rotation vector, °',
            *(_signed(f'{value * DEGREE:.4f}') for value in placed['rotation_vector']),
        ],
    ]
    text = table('', ['flange to probe (P of eq. 14)', 'x', 'y', 'z'], rows, range(1, 4))
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
    text = part('Repetitions')
    for method, name in made.items():
        text += paragraph(_repeated(name, found[method], found['seed']))
    rows = []
    for parameter in found['parameters']:
        factor, unit = UNITS[parameter['unit']]
        sizes = (parameter[key] for key in ('analytic', *made))
        cells = (NOTHING if size is None else f'{size * factor:.5f}' for size in sizes)
        rows.append([parameter['name'], *cells, unit])
    header = ['std. uncertainty', 'stated', *made.values(), 'unit']
    return text + table('', header, rows, range(1, 2 + len(made)))


def _repeated(name: str, found: Record, seed: int) -> str:
    text = (
        f'{name[0].upper()}{name[1:]}: {found["repetitions"]} repetitions (seed {seed}), '
        f'{found["converged"]} converged; standard uncertainty of a position over the workspace '
        f'{mm(found["position_uncertainty_rms"])} mm rms.'
    )
    if found['ratio_to_analytic'] is not None:
        ratio = found['ratio_to_analytic']
        text += f' Parameters are {ratio:.2f} times as unsure as stated (median).'
    return text
