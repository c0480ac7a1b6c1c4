# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from simulated_calibration import active, kr5, simulate

from calib_solver.identification import identify
from calib_solver.nodes import residual_markers as markers
from calib_solver.nodes.residual_markers import residuals

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def done():
    return identify(simulate(kr5(), active(), 83, noise=5e-5, poses=12).measured)


def test_every_pose_is_as_many_times_farther_off_as_asked(done):
    before, after = residuals(done.problem, done.initial, done.identified, 200.0)
    for shown, quality in ((before, done.initial), (after, done.identified)):
        ends = shown.points.reshape(-1, 2, 3)
        drawn = (ends[:, 1] - ends[:, 0]) / 200.0
        assert np.abs(drawn - quality.deviation).max() < 1e-12
        centers = {tuple(np.round(center, 9)) for center in quality.spheres.center}
        assert {tuple(np.round(start, 9)) for start in ends[:, 0]} == centers
    assert np.ptp(after.points, axis=0).max() > 0.1  # all over the gauge's places


def test_more_than_an_eye_can_tell_are_thinned_out(done, monkeypatch):
    monkeypatch.setattr(markers, 'SHOWN', 50)
    before, after = residuals(done.problem, done.initial, done.identified, 1.0)
    assert 25 <= len(before.points) // 2 == len(after.points) // 2 <= 50
