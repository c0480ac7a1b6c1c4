# SPDX-License-Identifier: Apache-2.0
"""The demo's other arms and probes, with few poses; the whole of the first has test_demo.py."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from calib_bringup.demo import CAPTURES, arguments, replaceable
from calib_bringup.variants import DEFAULT, VARIANTS
from calib_model.bags import read_measurement
from calib_model.command_line import UsageError

ROOT = Path(__file__).resolve().parent.parent
#: variant: its arm, its probe, how much smaller the held-out 2 sigma is at least
EXPECTED = {
    'passive': ('kuka_kr5_sixx_r650', 'passive_seat_kr5', 4.0),
    'iiwa14': ('kuka_lbr_iiwa14', 'active_trihedron', 20.0),
    'faro': ('faro_sterling', 'passive_seat_faro', 4.0),
}
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


@pytest.mark.parametrize('name', EXPECTED)
def test_a_variant_ends_with_the_table_of_its_own_arm_and_probe(name, tmp_path):
    environment = os.environ | {'OMP_NUM_THREADS': '1'}
    folder = tmp_path / 'output' / f'demo_{name}'
    for capture in CAPTURES:  # an earlier demo's, which this one replaces
        (folder / capture).mkdir(parents=True)
    (folder / 'result.json').write_text('{}')
    done = subprocess.run(
        [sys.executable, '-m', 'calib_bringup.demo', '--variant', name, '--poses', '12'],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert (done.returncode, done.stderr) == (0, '')
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
    assert replaceable(folder)
    arm, probe, gain = EXPECTED[name]
    measured = read_measurement(folder / 'identification')
    assert (measured.arm.name, measured.probe.name) == (arm, probe)
    quality = json.loads((folder / 'result.json').read_text())['quality']
    head, *rows = done.stdout.splitlines()[-5:]
    assert ' '.join(head.split()) == 'mm initial identified held-out initial held-out identified'
    for row, (group, key) in zip(
        rows,
        [('distance', 'mean'), ('distance', 'max'), ('two_sigma', 'mean'), ('two_sigma', 'max')],
        strict=True,
    ):
        expected = [
            quality[q][group][key] * 1e3 for q in ('initial', 'identified', 'test_initial', 'test')
        ]
        assert [float(cell) for cell in row[22:].split()] == pytest.approx(expected, abs=6e-5)
    before, after = (quality[q]['two_sigma']['mean'] for q in ('test_initial', 'test'))
    assert before > 1e-4  # m: there was something to find
    assert after * gain < before


def test_all_variants_are_tried_and_an_unknown_one_is_refused_with_the_known_ones():
    assert set(VARIANTS) == {DEFAULT, *EXPECTED}
    with pytest.raises(UsageError, match="invalid choice: 'scara'.*faro.*iiwa14.*kr5.*passive"):
        arguments().parse_args(['--variant', 'scara'])


@pytest.mark.skipif(shutil.which('make') is None, reason='no make here')
@pytest.mark.parametrize('words', [['demo'], *(['demo', '--', name] for name in EXPECTED)])
def test_make_demo_takes_a_variant_s_name(words):
    dry = subprocess.run(
        ['make', '-n', *words], cwd=ROOT, capture_output=True, text=True, timeout=30, check=True
    )
    started = [line for line in dry.stdout.splitlines() if 'for variant in' in line]
    assert len(started) == 1
    assert f'for variant in {words[-1] if "--" in words else DEFAULT};' in started[0]
