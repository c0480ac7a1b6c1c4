# SPDX-License-Identifier: Apache-2.0
"""What the diagnostics say in words."""

from dataclasses import replace

import numpy as np
from simulated_calibration import active, kr5, simulate

from calib_model.bags import write_measurement
from calib_solver.commands.identify import run as calibrate
from calib_solver.fitting import USUAL_PRIOR
from calib_solver.results.diagnostics import prior_words


def test_widths_are_told_in_two_digits_as_people_write_them():
    widths = [{'kind': 'theta_0', 'times': 1234.5}, {'kind': 'a', 'times': 0.5274}]
    zero = 1234.5 * USUAL_PRIOR.sigma['theta_0']
    found = {'name': 'theta_0_2', 'free': True, 'initial': 0.5, 'identified': 0.5 + zero}
    prior = {'strength': 1.0, 'widths': widths}
    said = prior_words({'diagnostics': {'prior': prior}, 'parameters': [found]})
    assert 'zeros 1200, lengths a 0.53' in said and "this arm's zeros are 1200 times" in said


def test_only_what_was_found_far_off_is_called_that(tmp_path):
    """What is held as wide as the other kinds need not be."""
    scene = simulate(kr5(), active(), 5, locations=3, poses=12, noise=1e-5)
    geometry = scene.measured.arm.geometry.copy()
    geometry[3] += np.radians([20.0, -15.0, 25.0, 18.0, -22.0, 16.0])
    arm = scene.measured.arm.with_geometry(geometry)
    write_measurement(tmp_path / 'bag', replace(scene.measured, arm=arm))
    record = calibrate([str(tmp_path / 'bag'), '--quick']).record
    widths = record['diagnostics']['prior']['widths']
    assert {one['kind']: one['times'] for one in widths}['a'] > 2
    said = prior_words(record).partition('Further off')[2]
    assert "this arm's zeros are 1" in said
    assert not any(kind in said for kind in ('lengths', 'twists', 'offsets', 'tilts'))
