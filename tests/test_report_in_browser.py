# SPDX-License-Identifier: Apache-2.0
"""The report in a real browser: on a telephone and on a desk, light, dark and on paper."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

from browser import Browser, found
from simulated_calibration import passive, simulate, ur_like

from calib_model.bags import write_measurement
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
WIDTHS = (360, 1400)
VIEWS = [(width, dark) for width in WIDTHS for dark in (False, True)]
REPORTS = ('held_out', 'warned')
A4 = 642  # px between the margins

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
