# SPDX-License-Identifier: Apache-2.0
"""A gauge that is not as warm as its certificate: from a bag's note or an option to the result."""

import json
from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import GAUGE, active, kr5, simulate

from calib_model.bags import Temperature, read_temperature, write_measurement
from calib_model.errors import BagError
from calib_model.instruments import Expansion
from calib_solver.commands.identify import main, run

pytestmark = pytest.mark.timeout(60)
STEEL = Expansion(11.5e-6, 1e-6)


@pytest.fixture(scope='module')
def warm():
    """Measured on the gauge as it is at 28 deg C, by a certificate for 20."""
    gauge = replace(GAUGE, expansion=STEEL)
    scene = simulate(kr5(), active(), 5, locations=5, poses=12, noise=1e-6)
    # the same poses with a certificate that was written 8 K below
    cold = tuple(
        (number, tuple(np.array(center) / (1 + 8 * 11.5e-6))) for number, center in gauge.spheres
    )
    return replace(scene.measured, gauge=replace(gauge, spheres=cold))


def written(folder, measured, note=None):
    """A bag of the measurement, with a note of the temperature."""
    write_measurement(folder, measured, notes={'gauge temperature': note} if note else {})
    return str(folder)


def lengths(result):
    rows = json.loads((result / 'result.json').read_text())['parameters']
    return np.array([row['identified'] for row in rows if row['name'] in ('a2', 'd4')])


def test_the_option_and_the_note_give_the_same_and_a_longer_arm(warm, tmp_path, capsys):
    noted = written(tmp_path / 'noted', warm, Temperature(28.0, 0.5).content())
    plain = written(tmp_path / 'plain', warm)
    options = ['--temperature', '28', '--temperature-uncertainty', '0.5']
    for bag, more, out in ((noted, [], 'a'), (plain, options, 'b'), (plain, [], 'c')):
        assert main([bag, *more, '--output', str(tmp_path / out)]) == 0
    said = capsys.readouterr().out
    assert said.count("the gauge's lengths are taken at 28 deg C: +92.00 um/m") == 2
    assert "the gauge's temperature is not given: each kelvin from 20 deg C" in said
    by_note, by_option, without = (lengths(tmp_path / out) for out in 'abc')
    assert np.array_equal(by_note, by_option)
    assert by_note / without == pytest.approx(1 + 8 * 11.5e-6, abs=3e-6)
    record = json.loads((tmp_path / 'a/result.json').read_text())['diagnostics']
    assert record['scale']['temperature'] == 28.0
    assert record['scale']['standard_uncertainty'] == pytest.approx(np.hypot(8e-6, 5.75e-6))
    assert json.loads((tmp_path / 'c/result.json').read_text())['diagnostics']['scale'] is None


def test_what_is_not_known_of_the_scale_is_in_every_stated_length(warm, tmp_path):
    bag = written(tmp_path / 'bag', warm)
    sure, unsure = (
        run([bag, '--temperature', '28', '--temperature-uncertainty', text]).record
        for text in ('0', '20')
    )
    at = [one['name'] for one in sure['parameters']].index('a2')
    stated = [one['parameters'][at]['standard_uncertainty'] for one in (sure, unsure)]
    assert stated[1] > 0.9 * 20 * 11.5e-6 * 0.27 > 5 * stated[0]


def test_a_temperature_without_an_expansion_is_refused_in_one_line(tmp_path, capsys):
    scene = simulate(kr5(), active(), 6, locations=2, poses=8, noise=1e-6)
    bag = written(tmp_path / 'bag', scene.measured)
    assert main([bag, '--temperature', '25']) == 2
    line = capsys.readouterr().err
    assert 'expansion' in line and line.count('\n') == 1
    assert main([bag, '--temperature', '300 K']) == 2


def test_a_note_that_is_none_is_named(warm, tmp_path):
    for number, note in enumerate(({'celsius': 'warm'}, {'kelvin': '300'}, {'celsius': '-400'})):
        with pytest.raises(BagError, match='gauge temperature'):
            read_temperature(written(tmp_path / f'bag_{number}', warm, note))
