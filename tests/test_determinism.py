# SPDX-License-Identifier: Apache-2.0
"""The same bag gives the same result: bit for bit, and whatever the number of threads."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.system

DEMO = Path(__file__).parents[1] / 'bags' / 'demo'
WRITTEN = ('arm.yaml', 'arm.urdf', 'probe.yaml')


def run(module, *words, **environment):
    subprocess.run(
        [sys.executable, '-m', module, *map(str, words)],
        check=True,
        capture_output=True,
        env={**os.environ, **environment},
        timeout=100,
    )


def timeless(record):
    """Drop how long it took, and the hash of the report, which tells the minute it was made in."""
    return {key: value for key, value in record.items() if key not in ('seconds', 'report.html')}


def identified(bag, output, *more, threads=2):
    """What `identify` wrote, without all that may differ: how long it took."""
    run(
        'calib_solver.commands.identify', bag, '--output', output, *more, CALIB_THREADS=str(threads)
    )
    record = json.loads((output / 'result.json').read_text(), object_hook=timeless)
    return record, {name: (output / name).read_bytes() for name in WRITTEN}


@pytest.fixture(scope='module')
def hand_guided(tmp_path_factory):
    bag = tmp_path_factory.mktemp('faro') / 'bag'
    run('selfcenter_probe.commands.hand_guided', bag, '--probe', 'active', '--seed', 3)
    return bag


def test_twice_the_same_bag_is_twice_the_same_result(tmp_path):
    options = ('--test', DEMO / 'held_out', '--bootstrap', 4, '--monte-carlo', 4)
    first = identified(DEMO / 'identification', tmp_path / 'first', *options)
    assert first == identified(DEMO / 'identification', tmp_path / 'second', *options)


def numbers(record):
    if isinstance(record, dict):
        return [number for value in record.values() for number in numbers(value)]
    if isinstance(record, list):
        return [number for value in record for number in numbers(value)]
    return [record] if isinstance(record, float) else []


def test_the_number_of_threads_changes_nothing(hand_guided, tmp_path):
    one, _ = identified(hand_guided, tmp_path / 'one', threads=1)
    two, _ = identified(hand_guided, tmp_path / 'two', threads=2)
    assert numbers(one) == pytest.approx(numbers(two), rel=1e-9, abs=1e-15)
