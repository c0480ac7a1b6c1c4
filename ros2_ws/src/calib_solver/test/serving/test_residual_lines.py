# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate

from calib_solver.identification import identify
from calib_solver.serving import residual_lines
from calib_solver.serving.residual_lines import residuals

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def done():
    return identify(simulate(kr5(), active(), 83, noise=5e-5, poses=12).measured)


def test_every_pose_is_as_many_times_farther_off_as_asked(done):
    before, after = residuals(done)
    for shown, quality in ((before, done.initial), (after, done.identified)):
        ends = shown.lines(200.0).reshape(-1, 2, 3)
        drawn = (ends[:, 1] - ends[:, 0]) / 200.0
        assert np.abs(drawn - quality.deviation).max() < 1e-12
        centers = {tuple(np.round(center, 9)) for center in quality.spheres.center}
        assert {tuple(np.round(start, 9)) for start in ends[:, 0]} == centers
    assert np.ptp(after.lines(200.0), axis=0).max() > 0.1  # all over the gauge's places


def test_more_than_an_eye_can_tell_are_thinned_out(done, monkeypatch):
    monkeypatch.setattr(residual_lines, 'SHOWN', 50)
    before, after = (one.lines(1.0) for one in residuals(done))
    assert 25 <= len(before) // 2 == len(after) // 2 <= 50
