# SPDX-License-Identifier: Apache-2.0
"""The studies are all run, all told of, and their files say by what command they came."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

from studies.running import RESULTS, findings, written

MAKEFILE = (ROOT / 'Makefile').read_text(encoding='utf-8')
STUDIES = [
    name
    for listed in re.findall(r'^(?:ONE_CORE|TWO_CORES) := (.*)$', MAKEFILE, re.MULTILINE)
    for name in listed.split()
]


def modules_with_a_study() -> set[str]:
    """The files in studies/ that can be run as one."""
    files = (ROOT / 'studies').glob('*.py')
    return {file.stem for file in files if '__main__' in file.read_text(encoding='utf-8')}


def test_make_studies_runs_every_one():
    assert set(STUDIES) == modules_with_a_study()
    assert len(set(STUDIES)) == len(STUDIES)


@pytest.mark.parametrize('name', STUDIES)
def test_a_studys_file_begins_with_its_command_and_what_it_is_about(name):
    text = (RESULTS / f'{name}.txt').read_text(encoding='utf-8')
    assert text.startswith(written(name, import_module(f'studies.{name}').ABOUT, []))


@pytest.mark.parametrize('name', STUDIES)
def test_the_readme_tells_of_it(name):
    assert f'`{name}`' in (ROOT / 'studies/README.md').read_text(encoding='utf-8')


def test_a_finding_that_does_not_hold_says_so():
    assert findings([('it rains', False), ('it pours', True)]) == ['NO  it rains', 'yes it pours']
