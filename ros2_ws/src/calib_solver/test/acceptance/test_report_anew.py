# SPDX-License-Identifier: Apache-2.0
"""A report is made anew from its folder alone, and the folder stays one result."""

from __future__ import annotations

import json
import shutil

import pytest
from simulated_calibration import kr5, passive, simulate

from calib_model.bags import write_measurement
from calib_model.files import refuse_mixture
from calib_solver.calibration import Sources, calibrate
from calib_solver.commands.report import main
from calib_solver.fitting import Options

pytestmark = [pytest.mark.timeout(60), pytest.mark.slow]


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A result whose bag is gone."""
    folder = tmp_path_factory.mktemp('anew')
    measured = simulate(kr5(), passive(), 12, locations=3, poses=6, noise=1e-4).measured
    write_measurement(folder / 'bag', measured)
    calibrate(Sources((str(folder / 'bag'),)), Options(quick=True), (), str(folder / 'out'))
    shutil.rmtree(folder / 'bag')
    return folder / 'out'


@pytest.fixture
def result(made, tmp_path):
    return shutil.copytree(made, tmp_path / 'out')


def test_it_needs_no_bag_and_says_what_it_is_told(result, tmp_path, capsys):
    before = json.loads((result / 'result.json').read_text())
    (tmp_path / 'info.yaml').write_text('number: Q-9\noperator: Somebody\n')
    assert main([str(result), '--info', str(tmp_path / 'info.yaml')]) == 0
    assert capsys.readouterr().out == f'wrote {result / "report.html"}\n'
    page = (result / 'report.html').read_text()
    assert 'Calibration report Q-9' in page
    assert page.count('<figure') >= 15
    refuse_mixture(result)
    after = json.loads((result / 'result.json').read_text())
    assert {**before, 'files': None} == {**after, 'files': None}
    assert main([str(result)]) == 0
    assert 'Q-9' not in (result / 'report.html').read_text()


def test_what_cannot_be_used_is_one_line_and_changes_nothing(result, tmp_path, capsys, monkeypatch):
    before = {path.name: path.read_bytes() for path in result.iterdir()}
    (tmp_path / 'info.yaml').write_text('colour: red\nnumber: 1\n')
    monkeypatch.setenv('PATH', str(tmp_path))
    monkeypatch.delenv('CHROMIUM', raising=False)
    for words, said in (
        ([str(result), '--info', str(tmp_path / 'info.yaml')], 'colour: unknown key'),
        ([str(result), '--pdf'], 'no Chromium on this machine'),
        ([str(result), '--paper', 'A3'], 'A4 or Letter'),
        ([str(tmp_path)], 'result.json: cannot be read'),
    ):
        assert main(words) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count('\n') == 1
    assert {path.name: path.read_bytes() for path in result.iterdir()} == before


def test_a_mixture_and_a_result_without_its_charts_are_refused_by_name(result, capsys):
    text = (result / 'arm.yaml').read_text()
    (result / 'arm.yaml').write_text(f'{text}# changed\n')
    assert main([str(result)]) == 2
    assert 'arm.yaml: not the file' in capsys.readouterr().err
    (result / 'arm.yaml').write_text(text)
    record = json.loads((result / 'result.json').read_text())
    del record['files']
    (result / 'result.json').write_text(json.dumps(record))
    (result / 'report.json').unlink()
    assert main([str(result)]) == 2
    assert 'report.json: there is none' in capsys.readouterr().err
