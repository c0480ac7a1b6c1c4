# SPDX-License-Identifier: Apache-2.0
"""docs/method.md names functions that are there, and every equation of the chapter."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

DOCUMENT = Path(__file__).resolve().parents[1] / 'docs' / 'method.md'
NAMED = re.compile(r'`((?:calib|selfcenter)_\w+(?:\.\w+)+)`')
EQUATIONS = set(range(1, 18))


def rows() -> list[list[str]]:
    lines = [line for line in DOCUMENT.read_text().splitlines() if line.startswith('| ')]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines]


def test_every_equation_of_the_chapter_has_its_row():
    found: set[int] = set()
    for equations, _, functions in rows():
        if re.fullmatch(r'[\d, to]+', equations):
            assert NAMED.search(functions), equations
            for part in equations.split(','):
                ends = [int(number) for number in part.split('to')]
                found |= set(range(ends[0], ends[-1] + 1))
    assert found == EQUATIONS


@pytest.mark.parametrize('name', sorted(set(NAMED.findall(DOCUMENT.read_text()))))
def test_what_is_named_is_there(name):
    try:
        importlib.import_module(name)
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition('.')
        assert hasattr(importlib.import_module(module), attribute)
