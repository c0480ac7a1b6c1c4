# SPDX-License-Identifier: Apache-2.0
"""The report's account of what the identified parameters leave, and of how they were computed."""

from __future__ import annotations

from math import sqrt

from calib_solver.report.html import counted, mm, paragraph, part, table, two_digits
from calib_solver.results import Record, prior_words

#: a misfit (of variance) from which on the arm is doubted: twice the scatter. A smaller one stands
#: beside the noise and is in the uncertainties, but near its own threshold it comes and goes with
#: the last digits, which no verdict may
DOUBTED = 4.0
SHOWN_REJECTED = 50
OBJECTIVES = {
    'distance_repeatability': 'distance errors and 2 sigma together (eq. 11)',
    'distance': 'distance errors alone (eq. 13)',
    'position': 'positions, what they are held against at its best place (eq. 10)',
}


def warnings(record: Record) -> list[str]:
    """What to doubt, the worst first."""
    lines = list(record['warnings'])
    if not record['solver']['converged']:
        lines.insert(0, f'Not converged: {record["solver"]["reason"]}')
    if record['rejected']:
        what = 'point' if 'stations' in record else 'pose'
        lines.append(
            f'{counted(len(record["rejected"]), what)} left out as gross errors, listed under '
            'Residuals.'
        )
    unseen = [p['name'] for p in record['parameters'] if p['free'] and not p['identifiable']]
    if unseen:
        lines.append('Not told by these poses, kept near nominal: ' + ', '.join(unseen))
    if record['diagnostics']['misfit'] > DOUBTED:
        lines.append(
            f'The locations scatter {sqrt(record["diagnostics"]["misfit"]):.2g} times as much as '
            'the noise explains: the arm has errors that its parameters cannot say. The stated '
            'uncertainties are enlarged accordingly.'
        )
    return lines


def rejected(record: Record) -> str:
    """The poses left out, the worst first; nothing where every pose was used."""
    worst = sorted(record['rejected'], key=lambda one: -one['size'])
    if not worst:
        return ''
    rows = [
        [str(r['pose']), str(r['location']), str(r['sphere']), mm(r['size']), r['reason']]
        for r in worst[:SHOWN_REJECTED]
    ]
    text = f'{len(worst)} in all' + (', the worst shown.' if len(worst) > len(rows) else '.')
    header = ['pose', 'location', 'sphere', 'off by, mm', 'why']
    return (
        part('Poses left out') + paragraph(text) + table('', header, rows, range(4), {4: 'words'})
    )


def by_location(record: Record) -> str:
    """Spread and distance errors of each location."""
    rows = [
        [str(r['location']), str(r['poses']), mm(r['rms']), mm(r['max']), mm(r['distance_mean'])]
        for r in record['diagnostics']['by_location']
    ]
    header = ['location', 'poses', 'rms, mm', 'max, mm', 'mean distance error, mm']
    return part('By location') + table('', header, rows, range(1, 5), name='narrow')


def by_joint(record: Record) -> str:
    """How much of the residuals goes with each joint's angle."""
    rows = [
        [r['joint'], f'{100 * r["explained"]:.1f} %', f'{100 * r["by_chance"]:.1f} %']
        for r in record['diagnostics']['by_joint']
    ]
    return (
        part('Against each joint')
        + paragraph(
            'Size of each residual by the joint\u2019s angle; the line is their rms. The table '
            'says what share of the residuals\u2019 variance goes with one joint\u2019s angle '
            'alone: much more than by chance is an error of that joint that '
            'Denavit-Hartenberg parameters cannot say.'
        )
        + table('', ['joint', 'goes with it', 'by chance'], rows, (1, 2), name='narrow')
    )


def sure(record: Record) -> str:
    """How sure a position is, and how far one pose scatters."""
    checks = record['diagnostics']
    misfit = checks['misfit']
    more = (
        f'; locations scatter {sqrt(misfit):.2g} times as much as that explains'
        if misfit > 1
        else ''
    )
    return paragraph(
        'Standard uncertainty of a position over the workspace: '
        f'{two_digits(checks["position_uncertainty_rms"])} mm rms, '
        f'{two_digits(checks["position_uncertainty_max"])} mm at most. One pose scatters by '
        f'{mm(checks["noise"])} mm (standard deviation per coordinate){more}.'
    ) + ''.join(paragraph(f'Not told by any such poses: {text}.') for text in checks['untold'])


def solver(record: Record) -> str:
    """Objective, steps, rank and prior, in words."""
    found, checks = record['solver'], record['diagnostics']
    condition = checks['condition']
    state = 'converged' if found['converged'] else 'not converged'
    text = (
        f'Objective: {OBJECTIVES.get(record["objective"], record["objective"])}. '
        f'Levenberg-Marquardt {state} after {found["iterations"]} iterations and '
        f'{found["evaluations"]} evaluations, phi from {found["phi_initial"] * 1e6:.4g} to '
        f'{found["phi_final"] * 1e6:.4g} mm²: {found["reason"]}. {checks["rank"]} of '
        f'{checks["free"]} directions are told by the poses, condition '
        f'{"infinite" if condition is None else f"{condition:,.0f}"}.'
    )
    return paragraph(text) + paragraph(prior_words(record))
