# SPDX-License-Identifier: Apache-2.0
"""The report says what result.json says, stands alone, and puts warnings first."""

from __future__ import annotations

import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate

from calib_model.bags import write_measurement
from calib_model.descriptions import gauge_yaml
from calib_model.errors import DescriptionError
from calib_solver.calibration import Effort, Sources, calibrate
from calib_solver.fitting import Options
from calib_solver.held_out import HeldOut
from calib_solver.identification import identify
from calib_solver.report.charts import Chart, Series, ranges
from calib_solver.report.evidence import evidence_of
from calib_solver.report.instruments import Inputs
from calib_solver.report.page import report_html
from calib_solver.report.png import all_charts
from calib_solver.resampling import Plan
from calib_solver.results import parse_info, result_record

pytestmark = pytest.mark.timeout(60)
VOID = {'meta', 'link', 'br'}
CLOSED_AT_ONCE = {'line', 'path'}
DEGREE = 57.29577951308232
COLUMNS = ('initial', 'identified', 'test_initial', 'test')
NOTHING = '–'


class Page(HTMLParser):
    """Tables by the heading above them, warnings, figures, and whether all that opens closes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.open: list[str] = []
        self.warnings: list[str] = []
        self.links: list[str] = []
        self.labels: list[str] = []
        self.unscoped = 0
        self._title = ''
        self._warning = False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.links += [values[key] for key in ('src', 'href') if key in values]
        if tag not in VOID | CLOSED_AT_ONCE:
            self.open.append(tag)
        if tag in ('h1', 'h2', 'h3'):
            self._title = ''
        if tag == 'tr':
            self.tables.setdefault(self._title, []).append([])
        if tag in ('td', 'th'):
            self.tables[self._title][-1].append('')
        if tag == 'th':
            self.unscoped += 'scope' not in values
        if tag == 'svg':
            self.labels.append(values.get('aria-label', ''))
        self._warning = values.get('class') == 'warning'

    def handle_endtag(self, tag):
        if tag not in VOID | CLOSED_AT_ONCE:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if not self.open:
            return
        if self.open[-1] in ('td', 'th'):
            self.tables[self._title][-1][-1] += data
        if self.open[-1] in ('h1', 'h2', 'h3'):
            self._title += data
        if self._warning and self.open[-1] == 'li':
            self.warnings.append(data)

    def rows(self, title):
        """The rows of the tables under a heading by their first cell."""
        return {row[0]: row[1:] for row in self.tables[title]}


def mm(value):
    """A length as the page shows it."""
    return NOTHING if value is None else shown(round(value * 1e3, 4) + 0.0, 4)


def shown(value, digits, sign=''):
    return format(value, f'{sign}.{digits}f').replace('-', '−')


def page_of(done, given=None, held_out=None, info=None):
    """The page as `identify` makes it and, by way of JSON, as `report` makes it anew: the same."""
    record, evidence = (
        result_record(done, held_out),
        evidence_of(done, given or Inputs(()), held_out),
    )
    text = report_html(record, evidence, info)
    kept = json.loads(json.dumps([record, evidence], allow_nan=False))
    assert report_html(*kept, info) == text
    return text


@pytest.fixture(scope='module')
def written(active_scene, tmp_path_factory):
    """The record and the page of a calibration with a held-out location, one slipped pose,
    repetitions and a gauge's certificate from a file of its own; and where its files are."""
    folder = tmp_path_factory.mktemp('report')
    measured = active_scene.measured
    poses = measured.poses
    joints = poses.joints.copy()
    joints[3, 1] += 0.05
    poses = replace(poses, joints=joints)
    last = poses.location == poses.location.max()
    for name, which in (('bag', ~last), ('held', last)):
        write_measurement(folder / name, replace(measured, poses=poses.take(which)))
    (folder / 'bar.yaml').write_text(gauge_yaml(measured.gauge))
    effort = Effort(Plan(monte_carlo=3, bootstrap=3))
    finished = calibrate(
        Sources((str(folder / 'bag'),), gauge=str(folder / 'bar.yaml')),
        Options(),
        [str(folder / 'held')],
        str(folder / 'out'),
        effort,
    )
    text = (folder / 'out' / 'report.html').read_text(encoding='utf-8')
    return finished.record, Page(text), text, folder


@pytest.mark.slow
def test_the_figures_people_ask_for_first_are_the_record_s(written):
    record, page, *_ = written
    rows = page.rows('In short')
    for group, label in (('distance', 'Distance error'), ('two_sigma', '2 sigma')):
        for key in ('mean', 'max'):
            expected = [mm(record['quality'][name][group][key]) for name in COLUMNS]
            assert rows[f'{label}, {key}'] == expected


def test_every_quality_in_the_page_is_the_record_s(written):
    record, page, *_ = written
    rows = page.rows('Quality')
    qualities = [record['quality'][name] for name in COLUMNS]
    for group, label, keys in (
        ('distance', 'distance error', ('max', 'min', 'mean', 'rms')),
        ('two_sigma', '2 sigma', ('max', 'min', 'mean')),
        ('position', 'position error', ('max', 'mean', 'rms')),
    ):
        for key in keys:
            assert rows[f'{label}, {key}'] == [mm(q[group][key]) for q in qualities]
    for axis, name in enumerate('XYZ'):
        expected = [mm(q['two_sigma']['mean_xyz'][axis]) for q in qualities]
        assert rows[f'2 sigma, mean {name}'] == expected
    assert rows['phi of eq. 11'] == [f'{q["phi"] * 1e6:.4g}' for q in qualities]


def test_what_causes_the_extremes_is_said_as_in_the_chapter(written):
    record, page, *_ = written
    causes = [row for row in page.tables['Quality'] if row[0].startswith('caused at')]
    order = [('distance', 'max'), ('distance', 'min'), ('two_sigma', 'max'), ('two_sigma', 'min')]
    for (group, end), row in zip(order, causes, strict=True):
        for name, cell in zip(COLUMNS, row[1:], strict=True):
            one = record['quality'][name][group]
            if group == 'distance':
                first, second = one[f'{end}_pair']
                place = f'D{first}\u2011{second}'
            else:
                place = f'B{one[f"{end}_sphere"]}, {one[f"{end}_coordinate"].upper()}'
            assert cell == f'location {one[f"{end}_location"]}, {place}'


def test_the_measuring_arm_s_quantities_are_the_record_s_and_say_what_they_are_not(written):
    record, page, text, _ = written
    rows = page.rows('As a measuring arm')
    arms = [record['quality'][name]['measuring_arm'] for name in COLUMNS]
    for label, group, key in (
        ('deviation from the seat’s mean, max', 'single_point', 'max_deviation'),
        ('2 s, largest of a seat', 'single_point', 'two_s_max'),
        ('2 s, mean of all seats', 'single_point', 'two_s_mean'),
        ('length deviation, max', 'length', 'max_deviation'),
        ('certified length there', 'length', 'max_length'),
        ('2 RMS', 'length', 'two_rms'),
        ('length deviation, mean', 'length', 'mean'),
        ('range', 'length', 'span'),
    ):
        assert rows[label] == [mm(arm[group][key]) for arm in arms]
    for label, group, key in (
        ('seats', 'single_point', 'spheres'),
        ('points', 'single_point', 'points'),
        ('lengths', 'length', 'count'),
    ):
        assert rows[label] == [str(arm[group][key]) for arm in arms]
    assert 'not a test by the standard' in text


def two_digits(size):
    """Decimals by which a size has two digits."""
    return max(0, 1 - int(np.floor(np.log10(size))))


def test_every_parameter_is_there_with_its_correction_its_uncertainty_and_its_reason(written):
    record, page, *_ = written
    rows = page.rows('Parameters')
    for parameter in record['parameters']:
        factor = 1e3 if parameter['unit'] == 'm' else DEGREE
        before, after = parameter['initial'] * factor, parameter['identified'] * factor
        sure = parameter['standard_uncertainty']
        digits = 5 if sure is None else two_digits(sure * factor)
        assert rows[parameter['name']] == [
            shown(before, digits),
            shown(after, digits),
            shown(after - before, digits, '+') if parameter['free'] else 'held',
            NOTHING if sure is None else shown(sure * factor, digits),
            parameter['reason'],
        ]
    assert {'parameter, mm', 'parameter, °'} <= set(rows)
    assert not any('times better' in parameter['reason'] for parameter in record['parameters'])


def test_mount_and_repetitions_are_the_record_s(written):
    record, page, *_ = written
    rows = page.rows('The probe on the flange')
    mount = record['flange_T_probe']
    for axis, along, about in zip(
        'xyz', mount['translation'], mount['rotation_vector'], strict=True
    ):
        assert rows[axis] == [shown(along * 1e3, 4), shown(about * DEGREE, 4)]
    rows = page.rows('Repetitions')
    for parameter in record['resampling']['parameters']:
        factor = 1e3 if parameter['unit'] == 'm' else DEGREE
        sizes = [parameter[key] for key in ('analytic', 'monte_carlo', 'bootstrap')]
        cells = [
            NOTHING if size is None else shown(size * factor, two_digits(size * factor))
            for size in sizes
        ]
        assert rows[parameter['name']] == cells


def test_the_quantities_of_iso_standards_are_the_record_s(written):
    record, page, *_ = written
    rows = page.rows('As defined in ISO 10360-12 and ISO 9283')
    found = [record['quality'][name]['standards'] for name in COLUMNS]
    for label, key in (
        ('location error L Dia, max', 'location_error'),
        ('length error E, max', 'length_error'),
        ('pose accuracy AP, max', 'pose_accuracy'),
        ('pose repeatability RP, max', 'pose_repeatability'),
        ('distance accuracy AD, max', 'distance_accuracy'),
        ('distance repeatability RD, max', 'distance_repeatability'),
    ):
        assert rows[label] == [mm(one[key]) for one in found]


def test_the_first_page_says_who_what_when_and_the_verdict(active_scene):
    measured = active_scene.measured
    stamps = 1_801_000_000 * 10**9 + np.arange(len(measured.poses)) * 10**9
    dated = replace(measured, poses=replace(measured.poses, stamp=stamps))
    last = dated.poses.location == 5
    done = identify(replace(dated, poses=dated.poses.take(~last)))
    held_out = HeldOut.by(replace(dated, poses=dated.poses.take(last)), done)
    quality = result_record(done, held_out)['quality']['test']
    limit = quality['distance']['max']
    info = parse_info(
        'number: K-31\noperator: "A. <Muster>"\nserials: {arm: "77", gauge: B-2}\n'
        f'temperature: 22.5\nlimits: {{distance_max: {1.1 * limit}, two_sigma_max: 1.0e-6}}\n'
    )
    text = page_of(done, held_out=held_out, info=info)
    rows = Page(text).rows('Kinematic calibration of kr5')
    assert rows['Readings'] == ['2027-01-26']
    assert rows['Arm'] == ['kr5, serial 77']
    assert rows['Probe'] == ['active_trihedron, serial not recorded']
    assert rows['Temperature'] == ['22.5 °C']
    assert rows['Operator'] == ['A. <Muster>']
    assert rows['distance_max'] == [mm(limit), mm(1.1 * limit), 'passed']
    assert rows['two_sigma_max'][2] == 'failed'
    assert 'Calibration report K-31' in text
    assert 'Failed: 1 of 2 limits kept, judged on held-out poses.' in text
    assert 'Nothing was held out' not in text
    assert 'Simulated' not in text
    assert re.search(r'<title>pose \d+, location \d+, B\d+</title>', text)


def test_what_was_simulated_and_what_was_not_held_out_is_said(clean_scene):
    measured = clean_scene.measured
    told = replace(measured, probe=replace(measured.probe, simulated=True))
    text = page_of(identify(told, Options(quick=True)))
    assert 'class="marked" role="note">Simulated: no real arm was measured.' in text
    assert 'class="marked" role="note">Nothing was held out' in text


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('numbre: 3', 'numbre'),
        ('number: 3\nsomething: 4', 'something: unknown key'),
        ('temperature: hot', 'temperature'),
        ('temperature: 2000', 'temperature'),
        ('serials: 12', 'serials'),
        ('limits: {width: 1.0e-4}', 'width'),
    ],
)
def test_information_that_cannot_be_used_is_refused_by_name(text, named):
    with pytest.raises(DescriptionError, match=named):
        parse_info(text, 'info.yaml')


def test_residuals_by_location_and_joint_are_the_record_s(written):
    record, page, *_ = written
    rows = page.rows('By location')
    for one in record['diagnostics']['by_location']:
        cells = [mm(one[key]) for key in ('rms', 'max', 'distance_mean')]
        assert rows[str(one['location'])] == [str(one['poses']), *cells]
    rows = page.rows('Against each joint')
    for one in record['diagnostics']['by_joint']:
        assert rows[one['joint']] == [
            f'{100 * one[key]:.1f} %' for key in ('explained', 'by_chance')
        ]


def test_warnings_come_first_and_what_was_left_out_is_listed(written):
    record, page, text, _ = written
    assert record['warnings']
    assert page.warnings[: len(record['warnings'])] == record['warnings']
    assert text.index('class="warning"') < text.index('<section>')
    worst = max(record['rejected'], key=lambda one: one['size'])
    row = [str(worst['pose']), str(worst['location']), str(worst['sphere']), mm(worst['size'])]
    assert row in [cells[:4] for cells in page.tables['Poses left out']]


def test_nothing_is_warned_of_where_there_is_nothing(clean_scene, tmp_path):
    write_measurement(tmp_path / 'bag', clean_scene.measured)
    done = identify(clean_scene.measured)
    page = Page(page_of(done, Inputs((str(tmp_path / 'bag'),))))
    assert page.warnings == []
    assert len(page.tables['Quality'][0]) == 3  # no columns for what was not held out


def test_what_was_measured_with_what_is_said(written):
    _, page, text, folder = written
    rows = page.rows('What was measured')
    assert rows['Arm'][0].startswith('kr5, 6 joints')
    assert 'active' in rows['Probe'][0]
    assert rows['Gauge'] == ['bar, 15 spheres of 22 mm diameter']
    assert '1 µm + 1 µm/m · L' in rows['Certificate'][0]
    assert '319 poses of 16 spheres at 4 locations (1, 2, 3, 4)' in rows['Identified from'][0]
    assert '1 more left out' in rows['Identified from'][0]
    assert '80 poses of 4 spheres at 1 location (5)' in rows['Held out'][0]
    assert len(page.tables['Certificate of the gauge']) == 16
    files = {
        'identified from': next((folder / 'bag').glob('*.mcap')),
        'held out': next((folder / 'held').glob('*.mcap')),
        'gauge description': folder / 'bar.yaml',
    }
    for use, file in files.items():
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        assert page.rows('Files')[use] == [str(file), digest]


def test_the_readings_time_of_day_is_said_where_they_have_one():
    measured = simulate(kr5(), active(), 9, locations=2, poses=8, noise=5e-5).measured
    second = 10**9
    begin = 1_790_000_000 * second  # 2026-09-21 14:13:20 UTC
    stamps = begin + np.arange(len(measured.poses)) * second
    dated = replace(measured, poses=replace(measured.poses, stamp=stamps))
    done = identify(dated)
    text = page_of(done)
    assert 'readings stamped 2026-09-21 14:13:20 to 14:14:23 UTC' in text


def test_the_page_stands_alone_and_is_well_formed(written):
    _, page, text, _ = written
    assert page.open == []
    assert page.links == ['data:,']
    assert page.unscoped == 0
    assert '<script' not in text
    assert re.search(r'\bnan\b|\binf\b|None|1e-\d', re.sub(r'<style>.*?</style>', '', text)) is None


def test_every_chart_is_drawn_and_described(written):
    record, page, text, _ = written
    count = len(record['diagnostics']['by_joint']) + 4 + 3 + 4 + 1
    # the first of them stands on the first page, too
    assert text.count('<figure') == len(page.labels) == count + 1
    assert all(page.labels)
    assert len(set(page.labels)) == count


def test_charts_have_names_of_their_own(active_scene):
    charts = all_charts(identify(active_scene.measured), None)
    assert len({chart.name for chart in charts}) == len(charts)


@pytest.fixture(scope='module')
def beyond():
    """The record and the page of an arm whose encoders were offered as parameters, and eq. 12's
    correction used whether it helps or not."""
    measured = simulate(kr5(), active(), 21, locations=6, poses=8, noise=1e-4).measured
    seen = measured.poses.location < 6
    unseen = replace(measured, poses=measured.poses.take(~seen))
    options = Options(correction='harmonic', joint_errors=('encoder',))
    done = identify(replace(measured, poses=measured.poses.take(seen)), options)
    held_out = HeldOut.by(unseen, done)
    record = result_record(done, held_out)
    return record, Page(page_of(done, held_out=held_out))


def test_what_eq_12_corrects_stands_beside_what_it_does_not(beyond):
    record, page = beyond
    corrected = record['correction']['quality']
    qualities = [
        record['quality']['initial'],
        record['quality']['identified'],
        corrected['identified'],
        record['quality']['test_initial'],
        record['quality']['test'],
        corrected['test'],
    ]
    rows = page.rows('Quality')
    assert rows['2 sigma, mean'] == [mm(q['two_sigma']['mean']) for q in qualities]
    assert rows['distance error, max'] == [mm(q['distance']['max']) for q in qualities]


def test_gains_on_locations_left_out_are_the_record_s(beyond):
    record, page = beyond
    gain = record['correction']['gain']
    rows = page.rows('Correction functions (eq. 12)')
    for label, key in (
        ('all residuals, rms', 'rms'),
        ('2 sigma, rms', 'two_sigma'),
        ('distance error, rms', 'distance'),
    ):
        assert rows[label] == [mm(gain[f'{key}_before']), mm(gain[f'{key}_after'])]
    rows = page.rows('Joint errors')
    for tried in record['joint_errors']['tried']:
        assert rows[tried['kind']] == [
            'used' if tried['identified'] else 'refused',
            f'{shown(100 * tried["change"], 1, "+")} %',
            f'{tried["standard_error"]:.3f}',
            mm(tried['rms_before']),
            mm(tried['rms_after']),
        ]


def test_nothing_is_said_beyond_where_nothing_was_asked(written):
    _, page, *_ = written
    assert not {'Joint errors', 'Correction functions (eq. 12)'} & set(page.tables)


@pytest.mark.parametrize('spread', [0.0, 1e-18, 1e-16, 1e-12])
@pytest.mark.parametrize('middle', [0.0, 1.0, -300.0])
def test_a_chart_of_what_is_all_at_one_place_has_room_around_it(spread, middle):
    values = middle + spread * np.arange(3)
    chart = Chart('c', 't', '', 'x', 'y', (Series(values, values, 'after'),), equal=True)
    for axis in ranges(chart, 400.0, 300.0):
        assert axis.low < middle < axis.high and np.isfinite(axis.ticks).all()
