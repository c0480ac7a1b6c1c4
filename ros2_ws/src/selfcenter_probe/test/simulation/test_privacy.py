# SPDX-License-Identifier: Apache-2.0
"""The truth of the simulated world is known to this package alone."""

import ast
from pathlib import Path
from xml.etree import ElementTree

import pytest

SOURCE = Path(__file__).resolve().parents[3]
PACKAGE = 'selfcenter_probe'
OTHERS = ('calib_model', 'calib_capture', 'calib_solver', 'calib_interfaces')


def imported(file):
    for node in ast.walk(ast.parse(file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value  # importlib.import_module, a path to the package's files


def knows(file):
    return any(PACKAGE in name and not name.count(' ') for name in imported(file))


@pytest.mark.parametrize('package', OTHERS)
def test_no_measuring_package_knows_the_simulated_world(package):
    files = [
        file
        for file in (SOURCE / package / package).rglob('*.py')
        if file.name != 'calib.py'  # lists the commands of every package, and enters none
    ]
    assert files or package == 'calib_interfaces'
    assert [str(file) for file in files if knows(file)] == []


@pytest.mark.parametrize('package', OTHERS)
def test_no_measuring_package_depends_on_it(package):
    manifest = ElementTree.parse(SOURCE / package / 'package.xml').getroot()
    assert PACKAGE not in {(entry.text or '').strip() for entry in manifest.iter()}


def test_this_test_would_see_one_that_does(tmp_path):
    file = tmp_path / 'cheat.py'
    for text in (
        'from selfcenter_probe.simulation.world import World',
        'import selfcenter_probe',
        "import importlib; importlib.import_module('selfcenter_probe.simulation.world')",
    ):
        file.write_text(text)
        assert knows(file)
