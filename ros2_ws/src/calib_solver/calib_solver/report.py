# SPDX-License-Identifier: Apache-2.0
"""`report.html`: what was measured with what, what came out, how sure it is, and what to doubt."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from calib_model.bag_files import bag_files
from calib_solver.identification import Identification
from calib_solver.quality import Quality
from calib_solver.report_figures import all_figures
from calib_solver.report_page import charts, page, paragraph, section, table
from calib_solver.result import Record, quality_record

PACKAGES = ('calib_solver', 'calib_model', 'numpy', 'mcap')
SHOWN_REJECTED = 50


def report_html(
    done: Identification,
    record: Record,
    bags: Sequence[str],
    test_bags: Sequence[str] = (),
    test_initial: Quality | None = None,
    test: Quality | None = None,
) -> str:
    """The page; every figure in it is one of `record`, the content of result.json."""
    title = f'Kinematic calibration of {record["arm"]}'
    sections = [
        f'<h1>{title}</h1>',
        paragraph(_measured(done), 'faint'),
        *(f'<p class="warning">{_plain(text)}</p>' for text in _warnings(record)),
        section('Quality', _quality(done, test_initial, test), paragraph(_sure(record))),
        section('Pictures', charts(all_figures(done, test))),
        section('Parameters', _parameters(record)),
        section('The probe on the flange', _mount(record)),
    ]
    if record['rejected']:
        sections.append(section('Poses left out', _rejected(record)))
    sections.append(section('Where the residuals are', _locations(record), _joints(record)))
    sections.append(section('How it was computed', _solver(record)))
    sections.append(section('Inputs and versions', _inputs(bags, test_bags), _versions()))
    return page(title, sections)


def _plain(text: str) -> str:
    return text.replace('&', '&amp;').replace('<', '&lt;')


def _mm(value: float | None) -> str:
    return '-' if value is None else f'{value * 1e3:.4f}'


def _measured(done: Identification) -> str:
    measured = done.problem.measured
    stamps = measured.poses.stamp
    when = 'without a date'
    if len(stamps) and stamps.max() > 10**17:
        first, last = (
            datetime.fromtimestamp(int(s) / 1e9, timezone.utc) for s in (stamps.min(), stamps.max())
        )
        when = f"{first:%Y-%m-%d %H:%M:%S} to {last:%Y-%m-%d %H:%M:%S} UTC by the readings' stamps"
    return (
        f'{len(done.problem.joints)} poses of {len(done.problem.keys)} spheres at '
        f'{len(done.problem.locations)} locations of the gauge {measured.gauge.name}, probed with '
        f'{measured.probe.name} ({measured.probe.kind}), {when}. Lengths in mm.'
    )


def _warnings(record: Record) -> list[str]:
    warnings = list(record['warnings'])
    if not record['solver']['converged']:
        warnings.insert(0, f'Not converged: {record["solver"]["reason"]}')
    unseen = [p['name'] for p in record['parameters'] if p['free'] and not p['identifiable']]
    if unseen:
        warnings.append('Not told by these poses, kept near nominal: ' + ', '.join(unseen))
    if record['diagnostics']['misfit'] > 1:
        warnings.append(
            f'The locations scatter {record["diagnostics"]["misfit"]:.2f} times more than the '
            'noise explains: the arm has errors that its parameters cannot say. The stated '
            'uncertainties are enlarged accordingly.'
        )
    return warnings


def _quality(done: Identification, test_initial: Quality | None, test: Quality | None) -> str:
    columns = {'initial': done.initial, 'identified': done.identified}
    if test_initial is not None and test is not None:
        columns |= {'held-out, initial': test_initial, 'held-out, identified': test}
    records = [quality_record(quality) for quality in columns.values()]
    rows = []
    for group, label in (('distance', 'distance error'), ('two_sigma', '2 sigma')):
        for key in ('max', 'mean', 'min'):
            rows.append([f'{label}, {key}', *(_mm(r[group][key]) for r in records)])
        rows.append([f'{label}, worst at', *(_worst(r[group]) for r in records)])
    for axis, name in enumerate('XYZ'):
        means = [r['two_sigma']['mean_xyz'][axis] for r in records]
        rows.append([f'2 sigma, mean {name}', *(_mm(mean) for mean in means)])
    rows.append(['position error, rms', *(_mm(r['position']['rms']) for r in records)])
    rows.append(['phi (eq. 11), mm²', *(f'{r["phi"] * 1e6:.4g}' for r in records)])
    return table(['', *columns], rows, range(1, 5))


def _worst(record: Record) -> str:
    if record['max'] is None:
        return '-'
    if 'max_pair' in record:
        first, second = record['max_pair']
        return f'location {record["max_location"]}, D{first}-{second}'
    place = f'location {record["max_location"]}, B{record["max_sphere"]}'
    return f'{place}, {record["max_coordinate"].upper()}'


def _sure(record: Record) -> str:
    checks = record['diagnostics']
    return (
        'Standard uncertainty of a position over the workspace: '
        f'{checks["position_uncertainty_rms"] * 1e3:.4f} mm rms, '
        f'{checks["position_uncertainty_max"] * 1e3:.4f} mm at most. One pose scatters by '
        f'{checks["noise"] * 1e3:.4f} mm (standard deviation per coordinate).'
    )


def _parameters(record: Record) -> str:
    rows = []
    for p in record['parameters']:
        factor, unit = (1e3, 'mm') if p['unit'] == 'm' else (57.29577951308232, '°')
        change = (p['identified'] - p['initial']) * factor
        sure = p['standard_uncertainty']
        before, after = p['initial'] * factor, p['identified'] * factor
        rows.append([
            p['name'],
            f'{before:.5f} {unit}',
            f'{after:.5f} {unit}',
            f'{change:+.5f}' if p['free'] else 'held',
            '-' if sure is None else f'{sure * factor:.5f}',
            p['reason'],
        ])  # fmt: skip
    header = ['', 'initial', 'identified', 'correction', 'std. uncertainty', 'told by the data?']
    return table(header, rows, range(1, 5))


def _mount(record: Record) -> str:
    mount, fit = record['flange_T_probe'], record['probe_fit']
    x, y, z = (f'{value * 1e3:.4f}' for value in mount['translation'])
    rx, ry, rz = (f'{value * 57.29577951308232:.4f}' for value in mount['rotation_vector'])
    text = f'Translation {x}, {y}, {z} mm; rotation vector {rx}, {ry}, {rz}°.'
    if fit is None:
        return paragraph(text)
    start = (
        f'Eq. 15, from {fit["poses"]} poses of {fit["spheres"]} spheres, gave the start: residual '
        f'{fit["residual_rms"] * 1e3:.4f} mm rms, orthogonality error '
        f'{fit["orthogonality_error"]:.2g}, condition {fit["condition"]:.3g}.'
    )
    return paragraph(text) + paragraph(start)


def _rejected(record: Record) -> str:
    worst = sorted(record['rejected'], key=lambda one: -one['size'])
    rows = [
        [str(r['pose']), str(r['location']), str(r['sphere']), _mm(r['size']), r['reason']]
        for r in worst[:SHOWN_REJECTED]
    ]
    text = f'{len(worst)} in all' + (', the worst shown.' if len(worst) > len(rows) else '.')
    header = ['pose', 'location', 'sphere', 'off by, mm', 'why']
    return paragraph(text) + table(header, rows, (0, 1, 2, 3))


def _locations(record: Record) -> str:
    rows = [
        [str(r['location']), str(r['poses']), _mm(r['rms']), _mm(r['max']), _mm(r['distance_mean'])]
        for r in record['diagnostics']['by_location']
    ]
    header = ['location', 'poses', 'deviation, rms', 'deviation, max', 'distance error, mean']
    return table(header, rows, range(5))


def _joints(record: Record) -> str:
    rows = [
        [r['joint'], f'{100 * r["explained"]:.1f} %', f'{100 * r["by_chance"]:.1f} %']
        for r in record['diagnostics']['by_joint']
    ]
    header = ['joint', 'share of the residuals that goes with its angle', 'by chance']
    return table(header, rows, (1, 2))


def _solver(record: Record) -> str:
    solver, checks = record['solver'], record['diagnostics']
    condition = checks['condition']
    return paragraph(
        f'Objective {record["objective"]}, Levenberg-Marquardt: {solver["iterations"]} iterations, '
        f'{solver["evaluations"]} evaluations, phi from {solver["phi_initial"] * 1e6:.4g} to '
        f'{solver["phi_final"] * 1e6:.4g} mm²; {solver["reason"]}. {checks["rank"]} of '
        f'{checks["free"]} directions are told by the poses, condition '
        f'{"infinite" if condition is None else f"{condition:.3g}"}.'
    )


def _inputs(bags: Sequence[str], test_bags: Sequence[str]) -> str:
    rows = []
    for use, names in (('identified from', bags), ('held out', test_bags)):
        for name in names:
            for file in bag_files(name):
                rows.append([use, str(file), _sha256(file)])
    return table(['', 'file', 'SHA-256'], rows)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open('rb') as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def _versions() -> str:
    found = []
    for package in PACKAGES:
        try:
            found.append(f'{package} {version(package)}')
        except PackageNotFoundError:
            found.append(f'{package} (not installed as a package)')
    return paragraph(', '.join(found), 'faint')
