# SPDX-License-Identifier: Apache-2.0
"""The report says what result.json says, stands alone, and puts warnings first."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

import pytest

from calib_model.bag import write_measurement
from calib_solver.identification import Options
from calib_solver.loading import Sources, calibrate

pytestmark = pytest.mark.timeout(60)
VOID = {'meta', 'link', 'line', 'path', 'polyline', 'br'}


class Page(HTMLParser):
    """Cells of every table row, paragraphs by class, and whether all that opens is closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.rows: list[list[str]] = []
        self.open: list[str] = []
        self.warnings: list[str] = []
        self.links: list[str] = []
        self._warning = False
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.links += [values[key] for key in ('src', 'href') if key in values]
        if tag not in VOID:
            self.open.append(tag)
        if tag == 'tr':
            self.rows.append([])
        if tag in ('td', 'th'):
            self.rows[-1].append('')
        self._warning = values.get('class') == 'warning'

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] in ('td', 'th'):
            self.rows[-1][-1] += data
        if self._warning and self.open[-1] == 'p':
            self.warnings.append(data)


@pytest.fixture(scope='module')
def written(active_scene, tmp_path_factory):
    """The record and the page of a calibration with a held-out location and one slipped pose."""
    folder = tmp_path_factory.mktemp('report')
    measured = active_scene.measured
    poses = measured.poses
    joints = poses.joints.copy()
    joints[3, 1] += 0.05
    poses = replace(poses, joints=joints)
    last = poses.location == poses.location.max()
    for name, which in (('bag', ~last), ('held', last)):
        write_measurement(folder / name, replace(measured, poses=poses.take(which)))
    sources = Sources((str(folder / 'bag'),))
    finished = calibrate(sources, Options(), [str(folder / 'held')], str(folder / 'out'))
    return finished.record, (folder / 'out' / 'report.html').read_text(encoding='utf-8')


def test_every_quality_in_the_page_is_the_record_s(written):
    record, text = written
    rows = {row[0]: row[1:] for row in Page(text).rows if row and row[0]}
    quality = record['quality']
    for group, label in (('distance', 'distance error'), ('two_sigma', '2 sigma')):
        for key in ('max', 'mean', 'min'):
            shown = rows[f'{label}, {key}']
            for column, name in ((0, 'initial'), (1, 'identified'), (3, 'test')):
                assert shown[column] == f'{quality[name][group][key] * 1e3:.4f}'
    assert rows['position error, rms'][1] == f'{quality["identified"]["position"]["rms"] * 1e3:.4f}'


def test_every_parameter_is_there_with_its_reason(written):
    record, text = written
    rows = {row[0]: row for row in Page(text).rows if row and row[0]}
    for parameter in record['parameters']:
        factor = 1e3 if parameter['unit'] == 'm' else 57.29577951308232
        shown = rows[parameter['name']]
        assert shown[2].split()[0] == f'{parameter["identified"] * factor:.5f}'
        assert shown[5] == parameter['reason']


def test_warnings_come_first_and_what_was_left_out_is_listed(written):
    record, text = written
    page = Page(text)
    assert record['warnings']
    assert page.warnings[: len(record['warnings'])] == record['warnings']
    assert text.index('class="warning"') < text.index('<h2>')
    worst = max(record['rejected'], key=lambda one: one['size'])
    assert [str(worst['pose']), str(worst['location']), str(worst['sphere'])] in [
        row[:3] for row in page.rows
    ]


def test_the_page_stands_alone_and_is_well_formed(written):
    _, text = written
    page = Page(text)
    assert page.open == []
    assert page.links == ['data:,']
    assert '<script' not in text
    assert 'nan' not in text.lower().replace('nance', '')
    assert text.count('<figure>') == text.count('<svg') >= 10
