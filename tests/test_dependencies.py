# SPDX-License-Identifier: Apache-2.0
"""What set-up installs is pinned, and held against hashes."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PINNED = re.compile(r'[a-z0-9._-]+==\S+( ; [^-]*)?\s+--hash=sha256:[0-9a-f]{64}')


def asked(path):
    lines = (line.split('#')[0].strip() for line in path.read_text().splitlines())
    lines = (line for line in lines if line and not line.startswith('-'))
    return {re.split(r'[=<>! ]', line)[0].lower().replace('_', '-') for line in lines}


def pinned(path):
    lines = path.read_text().replace('\\\n', ' ').splitlines()
    return [line for line in lines if line.strip() and not line.startswith('#')]


@pytest.mark.parametrize('name', ['requirements', 'requirements-dev'])
def test_each_line_is_one_version_with_its_hashes(name):
    for line in pinned(ROOT / f'{name}.txt'):
        assert PINNED.match(line), line


@pytest.mark.parametrize('name', ['requirements', 'requirements-dev'])
def test_what_is_asked_for_is_pinned(name):
    lists = [ROOT / 'requirements.txt', ROOT / f'{name}.txt']
    known = {line.split('==')[0] for path in lists for line in pinned(path)}
    assert asked(ROOT / f'{name}.in') <= known


def test_one_version_serves_all_interpreters():
    lists = [ROOT / 'requirements.txt', ROOT / 'requirements-dev.txt']
    seen = [{line.split()[0] for line in pinned(path)} for path in lists]
    both = sorted(seen[0] | seen[1])
    assert [len(pinned(path)) for path in lists] == [len(one) for one in seen]
    assert len({line.split('==')[0] for line in both}) == len(both)
