# SPDX-License-Identifier: Apache-2.0
"""The rooms and packages import as docs/architecture.md says, and a slip is seen."""

from __future__ import annotations

import ast
import importlib
import re
from pathlib import Path

import architecture
import pytest
from architecture import ORDER, SOURCES

PAGE = Path(__file__).resolve().parents[1] / 'docs' / 'architecture.md'
CODE = architecture.sources()
FOLDERS = [name.removesuffix('.__init__') for name in CODE if name.endswith('.__init__')]


def test_nothing_is_imported_upwards_sideways_or_past_a_door() -> None:
    assert architecture.complaints(CODE) == []


@pytest.mark.parametrize(
    ('module', 'line', 'complaint'),
    [
        ('calib_model.arrays', 'import calib_solver', 'calib_model does not know calib_solver'),
        (
            'calib_capture.motion.approach',
            'from calib_solver import identify',
            'calib_capture does not know calib_solver',
        ),
        (
            'calib_solver.fitting.prior',
            'from calib_solver.report import write_report',
            'upwards, from fitting to report',
        ),
        (
            'calib_model.arrays',
            'if TYPE_CHECKING:\n    from calib_model.measurement import Measurement',
            'upwards, from arrays to measurement',
        ),
        (
            'calib_solver.identification',
            'def f():\n    from calib_solver.resampling import Plan',
            'upwards, from identification to resampling',
        ),
        (
            'calib_solver.report.page',
            'from calib_solver.commands.identify import run',
            'nobody imports commands',
        ),
        (
            'calib_capture.recording.recorder',
            'from calib_model.nodes import qos_of',
            'nobody imports nodes',
        ),
        (
            'calib_solver.report.page',
            'from calib_solver.quality.assessment import assess',
            'not a name that calib_solver.quality hands on',
        ),
        (
            'calib_solver.report.page',
            'import calib_model.bags.reader',
            'not a name that calib_model.bags hands on',
        ),
        (
            'calib_solver.report.page',
            'from calib_model.bags import reader',
            'not a name that calib_model.bags hands on',
        ),
        (
            'calib_solver.report.page',
            'from calib_model import bags\nbags.unheard_of()',
            'not a name that calib_model.bags hands on',
        ),
        (
            'calib_solver.quality.assessment',
            'from calib_solver import report\nreport.report_html()',
            'upwards, from quality to report',
        ),
        ('calib_capture.program.planner', 'from sensor_msgs.msg import Joy', 'ROS belongs in'),
        ('calib_solver.report.page', 'from . import charts', 'name the package'),
        ('calib_solver.report.charts', 'from calib_solver.report import png', 'circle: '),
        ('calib_solver.attic.old', 'import calib_model.arrays', 'attic has no place in the order'),
    ],
)
def test_one_line_too_many_is_seen(module: str, line: str, complaint: str) -> None:
    text = f'{CODE.get(module, "")}\n{line}\n'
    found = architecture.complaints({**CODE, module: text})
    assert any(complaint in one for one in found), found


def test_no_room_has_grown_into_a_hall() -> None:
    folders = {path.parent for path in SOURCES.rglob('*.py')}
    sizes = {folder: len(list(folder.glob('*.py'))) for folder in folders}
    assert {str(folder): size for folder, size in sizes.items() if size > 15} == {}


@pytest.mark.parametrize('folder', FOLDERS)
def test_a_folder_says_in_one_line_what_it_is_for(folder: str) -> None:
    said = ast.get_docstring(ast.parse(CODE[f'{folder}.__init__']))
    assert said and '\n' not in said


@pytest.mark.parametrize('folder', FOLDERS)
def test_names_are_handed_on_that_are_no_modules_and_can_be_loaded(folder: str) -> None:
    names = architecture.handed_on(CODE, folder)
    within = (name.removeprefix(f'{folder}.') for name in CODE if name.startswith(f'{folder}.'))
    modules = {name.split('.')[0] for name in within}
    assert set(names) & modules == set()
    if folder.endswith('.nodes'):
        pytest.importorskip('rclpy', reason='no ROS 2 here')
    loaded = importlib.import_module(folder)
    assert sorted(getattr(loaded, '__all__', [])) == sorted(names)
    assert [name for name in names if not hasattr(loaded, name)] == []


def drawn(heading: str) -> set[tuple[str, str]]:
    """The arrows of the graph under a heading of the page; `a --> b & c` is two."""
    section = PAGE.read_text().split(f'# {heading}\n', 1)[1]
    graph = section.split('```mermaid', 1)[1].split('```', 1)[0]
    lines = re.findall(r'^ *(\w+) --> (.+)$', graph, re.MULTILINE)
    return {(a, b) for a, targets in lines for b in targets.split(' & ')}


def test_the_page_draws_the_packages_as_they_import() -> None:
    assert drawn('Packages') == architecture.package_graph(CODE)


@pytest.mark.parametrize('package', ORDER)
def test_the_page_draws_the_rooms_as_they_import(package: str) -> None:
    assert drawn(package) == architecture.room_graph(CODE, package)


@pytest.mark.parametrize('package', ORDER)
def test_the_page_names_every_room_and_no_other(package: str) -> None:
    section = PAGE.read_text().split(f'# {package}\n', 1)[1].split('\n#', 1)[0]
    told = re.findall(r'^\| `(\w+)/?`', section, re.MULTILINE)
    rooms = {architecture.room(name)[1] for name in CODE if name.startswith(f'{package}.')}
    assert set(told) == rooms - {'__init__'} - architecture.BASE


def test_every_file_that_the_page_names_is_there() -> None:
    files = re.findall(r'`((?:calib|selfcenter)_[a-z_/]+\.py)`', PAGE.read_text())
    assert files
    for name in files:
        assert (SOURCES / name.split('/')[0] / name).is_file(), name
