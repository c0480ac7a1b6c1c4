# SPDX-License-Identifier: Apache-2.0
"""The report in a real browser: on a telephone and on a desk, light, dark and on paper."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

from browser import Browser, found
from simulated_calibration import passive, simulate, ur_like

from calib_model.bags import write_measurement
from calib_solver.acceptance import report_anew
from calib_solver.calibration import Effort, Sources, calibrate
from calib_solver.fitting import (
    Options,
    chosen_prior,
)
from calib_solver.resampling import Plan

PROGRAM = found()
pytestmark = [
    pytest.mark.system,
    pytest.mark.timeout(90),
    pytest.mark.skipif(
        PROGRAM is None, reason='no Chromium here (Debian, Ubuntu: apt-get install chromium)'
    ),
]
WIDTHS = (360, 768, 1400)
VIEWS = [(width, dark) for width in WIDTHS for dark in (False, True)]
REPORTS = ('held_out', 'warned')
#: px between the margins: A4 and Letter
SHEETS = {'A4': (642, 975), 'Letter': (663, 900)}
A4 = SHEETS['A4'][0]

# what is wider than the page though nothing scrolls it, or hides part of its own text
CUT = """[...document.querySelectorAll('body *')].filter(e => {
  const box = e.getBoundingClientRect(), style = getComputedStyle(e);
  const hides = ['hidden', 'clip'].includes(style.overflowX) && !(e instanceof SVGElement);
  const beyond = box.right > innerWidth + 0.5 && !e.closest('.scroll');
  return box.width && (beyond || box.left < -0.5 || hides && e.scrollWidth > e.clientWidth);
}).map(e => e.outerHTML.slice(0, 120))"""
# a figure without size, without a mark, or with marks that have no colour of their own
EMPTY = """[...document.querySelectorAll('figure')].filter(f => {
  const svg = f.querySelector('svg'), box = svg.getBoundingClientRect();
  const marks = [...svg.querySelectorAll('path:not(.grid)')];
  const paper = getComputedStyle(document.body).backgroundColor;
  const inked = m => [getComputedStyle(m).stroke, getComputedStyle(m).fill].some(
    c => c.startsWith('rgb') && c !== paper && c !== 'rgba(0, 0, 0, 0)');
  const drawn = m => { const b = m.getBBox();
    return m.getAttribute('d').length > 5 && isFinite(b.x + b.y + b.width + b.height)
      && b.x > -1 && b.y > -1 && b.x + b.width < svg.viewBox.baseVal.width + 1
      && b.y + b.height < svg.viewBox.baseVal.height + 1; };
  return box.width < 100 || box.height < 60 || !marks.length || !marks.every(inked)
    || !marks.every(drawn);
}).map(f => f.querySelector('figcaption').textContent)"""
# texts of a figure that lie on one another or run out of it
CLASHES = """[...document.querySelectorAll('figure')].flatMap(f => {
  const outer = f.getBoundingClientRect();
  const texts = [...f.querySelectorAll('svg text:not(.note)')];
  const boxes = texts.map(t => t.getBoundingClientRect());
  const found = [];
  boxes.forEach((a, i) => {
    if (a.left < outer.left - 6 || a.right > outer.right + 6) found.push(texts[i].textContent);
    boxes.slice(i + 1).forEach((b, k) => {
      if (a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 3
          && b.top < a.bottom - 3)
        found.push(texts[i].textContent + ' on ' + texts[i + 1 + k].textContent);
    });
  });
  return found.map(text => f.querySelector('b').textContent + ': ' + text);
})"""
# contrast (WCAG) of texts and of the marks' colours with what is behind them
CONTRAST = """(() => {
  const rgb = c => c.match(/[\\d.]+/g).map(Number);
  const light = c => { const [r, g, b] = rgb(c).slice(0, 3).map(v => v / 255).map(
    v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  const ratio = (a, b) => { const [x, y] = [light(a), light(b)].sort((p, q) => q - p);
    return (x + 0.05) / (y + 0.05); };
  const behind = e => { for (; e; e = e.parentElement) {
    const c = getComputedStyle(e).backgroundColor;
    if (c !== 'rgba(0, 0, 0, 0)') return c; } };
  const least = (query, property) => Math.min(...[...document.querySelectorAll(query)].map(
    e => ratio(getComputedStyle(e)[property], behind(e))));
  return {text: least('h1, h2, h3, p, td, th, li, figcaption b, .key', 'color'),
          axis: least('svg text', 'fill'),
          marks: least('.before, .after, .held, .x, .y', 'stroke')};
})()"""


@pytest.fixture(scope='module')
def reports(tmp_path_factory):
    """A report with held-out data and repetitions, and one of an arm that was not told."""
    folder = tmp_path_factory.mktemp('reports')
    bags = ROOT / 'bags' / 'demo'
    calibrate(
        Sources((str(bags / 'identification'),)),
        Options(),
        [str(bags / 'held_out')],
        str(folder / 'held_out'),
        Effort(Plan(monte_carlo=2)),
    )
    measured = simulate(ur_like(), passive(), 3, locations=1, poses=6, noise=1e-4).measured
    joints = measured.poses.joints.copy()
    joints[2, 1] += 0.2
    poses = replace(measured.poses, joints=joints)
    write_measurement(folder / 'bag', replace(measured, poses=poses))
    options = Options(prior=chosen_prior('auto'))
    calibrate(Sources((str(folder / 'bag'),)), options, (), str(folder / 'warned'))
    (folder / 'info.yaml').write_text(
        'number: 2031/7\noperator: N. Example\norganisation: Works\ntemperature: 20.4\n'
        'serials: {arm: A-1, probe: P-2, gauge: G-3}\nnotes: Nothing was changed before.\n'
        'limits: {distance_max: 1.1e-5, two_sigma_max: 2.2e-5, pose_accuracy: 3.3e-5}\n'
    )
    report_anew(str(folder / 'held_out'), str(folder / 'info.yaml'))
    return {name: folder / name / 'report.html' for name in REPORTS}


@pytest.fixture(scope='module')
def browser():
    with Browser(PROGRAM) as running:
        yield running


@pytest.mark.parametrize('name', REPORTS)
@pytest.mark.parametrize(('width', 'dark'), VIEWS)
def test_it_opens_without_a_complaint_and_nothing_is_cut(browser, reports, name, width, dark):
    browser.show(reports[name], width, dark)
    assert browser.evaluate('innerWidth') == width
    assert browser.complaints() == []
    assert browser.evaluate('document.scrollingElement.scrollWidth') <= width
    assert browser.evaluate(CUT) == []
    assert browser.evaluate('document.querySelectorAll("figure").length') >= 15
    assert browser.evaluate(EMPTY) == []
    assert browser.evaluate(CLASHES) == []


@pytest.mark.parametrize('dark', [False, True])
def test_texts_and_marks_stand_out(browser, reports, dark):
    browser.show(reports['held_out'], 1400, dark)
    lightness = browser.evaluate(
        'getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)[0]'
    )
    assert (lightness < 80) == dark
    contrast = browser.evaluate(CONTRAST)
    assert contrast['text'] >= 4.5
    assert contrast['axis'] >= 4.5
    assert contrast['marks'] >= 3


def test_warnings_are_seen_before_anything_else(browser, reports):
    browser.show(reports['warned'], 360)
    tops = browser.evaluate(
        '["aside.warnings", "section"].map(q => document.querySelector(q)'
        '.getBoundingClientRect().top)'
    )
    assert 0 < tops[0] < tops[1]
    assert tops[0] < 400


def test_on_paper_tables_are_whole_and_figures_keep_their_names(browser, reports, tmp_path):
    browser.show(reports['held_out'], A4, dark=True, media='print')
    assert browser.evaluate('document.scrollingElement.scrollWidth') <= A4
    assert (
        browser.evaluate(
            '[...document.querySelectorAll(".scroll")]'
            '.filter(e => e.scrollWidth > e.clientWidth + 1)'
            '.map(e => e.getAttribute("aria-label"))'
        )
        == []
    )
    assert browser.evaluate('getComputedStyle(document.body).backgroundColor') == (
        'rgb(255, 255, 255)'
    )
    assert browser.evaluate(
        '[...document.querySelectorAll("figure")].every('
        'f => getComputedStyle(f).breakInside === "avoid")'
    )
    browser.paper(tmp_path / 'report.pdf')
    pages = (tmp_path / 'report.pdf').read_bytes().count(b'/Type /Page\n')
    assert 4 <= pages <= 15


@pytest.mark.parametrize('name', REPORTS)
@pytest.mark.parametrize('paper', SHEETS)
def test_the_first_page_is_one_sheet(browser, reports, name, paper):
    width, height = SHEETS[paper]
    browser.show(reports[name], width, media='print')
    assert browser.evaluate('document.querySelector(".cover").getBoundingClientRect().bottom') < (
        height
    )
    assert browser.evaluate(CUT) == []


@pytest.mark.parametrize('paper', SHEETS)
def test_the_report_prints_on_the_paper_that_is_asked_for(reports, tmp_path, paper):
    folder = shutil.copytree(reports['held_out'].parent, tmp_path / 'printed')
    report_anew(str(folder), pdf=True, paper=paper)
    content = (folder / 'report.pdf').read_bytes()
    assert content.startswith(b'%PDF')
    wide, high = {'A4': (595, 842), 'Letter': (612, 792)}[paper]
    boxes = set(re.findall(rb'/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]', content))
    assert [(round(float(w)), round(float(h))) for w, h in boxes] == [(wide, high)]


def test_a_table_that_goes_on_says_so_and_a_point_has_a_name(browser, reports):
    browser.show(reports['held_out'], 360)
    wide = browser.evaluate(
        '[...document.querySelectorAll(".scroll")].filter(e => e.scrollWidth > e.clientWidth + 1)'
        '.map(e => getComputedStyle(e).backgroundImage)'
    )
    assert wide
    assert all(hint.count('gradient') == 4 for hint in wide)
    browser.show(reports['held_out'], 1400)
    named = browser.evaluate("""(() => {
      const found = [...document.querySelectorAll('.square circle')].slice(-40).map(c => {
        c.scrollIntoView({block: 'center'});
        const b = c.getBoundingClientRect();
        const e = document.elementFromPoint(b.left + b.width / 2, b.top + b.height / 2);
        return e.querySelector('title')?.textContent ?? '';
      });
      return found.every(text => /^pose \\d+, location \\d+, B\\d+$/.test(text));
    })()""")
    assert named


def test_what_the_browser_shows_is_what_result_json_says(browser, reports):
    record = json.loads((reports['held_out'].parent / 'result.json').read_text())
    browser.show(reports['held_out'], 768)
    shown = browser.evaluate(
        'Object.fromEntries([...document.querySelectorAll(".key-figures tbody tr")].map('
        'r => [...r.cells].map(c => c.innerText)).map(([name, ...cells]) => [name, cells]))'
    )
    columns = ('initial', 'identified', 'test_initial', 'test')
    for label, group in (('Distance error', 'distance'), ('2 sigma', 'two_sigma')):
        for key in ('mean', 'max'):
            said = [f'{1e3 * record["quality"][name][group][key]:.4f}' for name in columns]
            assert shown[f'{label}, {key}'] == said
    first = browser.evaluate('document.querySelector(".cover").innerText')
    assert f'{1e3 * record["quality"]["test"]["distance"]["max"]:.4f} mm' in first
    assert 'CALIBRATION REPORT 2031/7' in first.upper()


def test_this_would_notice_an_error_a_request_and_a_cut_text(browser, tmp_path):
    (tmp_path / 'bad.html').write_text(
        '<!doctype html><link rel="icon" href="data:,"><body><script>nothing.at.all</script>'
        '<img src="http://localhost:9/x.png"><p style="width: 900px">wide</p>'
        '<p style="overflow: hidden; width: 3em; white-space: nowrap">more than fits here</p>'
        '<figure><figcaption><b>x</b></figcaption><svg viewBox="0 0 9 9"></svg></figure>'
    )
    browser.show(tmp_path / 'bad.html', 360)
    complaints = ' '.join(browser.complaints())
    assert 'nothing is not defined' in complaints
    assert 'localhost:9' in complaints
    assert len(browser.evaluate(CUT)) >= 2
    assert browser.evaluate(EMPTY) == ['x']
