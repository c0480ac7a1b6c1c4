# SPDX-License-Identifier: Apache-2.0
"""A fit that did not converge says who is to blame."""

from __future__ import annotations

import pytest
from simulated_calibration import kr5, passive, simulate

from calib_solver.fitting.options import Options
from calib_solver.fitting.prior import NO_PRIOR
from calib_solver.identification import identify

pytestmark = pytest.mark.timeout(60)


def test_directions_that_nothing_holds_are_named_in_the_reason():
    measured = simulate(kr5(), passive(), 83, poses=10).measured
    done = identify(measured, Options(free=('theta_0_1', 'd1'), prior=NO_PRIOR))
    assert not done.fit.converged
    told = done.fit.reason.split('told worst: ')[1].split('; ')
    assert {part for line in told[:2] for part in line.split(' with ')} == {'theta_0_1', 'd1'}


def test_a_parameter_that_two_others_can_stand_in_for_is_named_with_them():
    measured = simulate(kr5(), passive(), 84, poses=10).measured
    done = identify(measured, Options(free=('d2',), prior=NO_PRIOR))
    assert not done.fit.converged
    worst = done.fit.reason.split('told worst: ')[1].split('; ')[0]
    assert set(worst.split(' with ')) == {'d2', 'd3'}


def test_a_fit_that_converged_blames_nobody():
    done = identify(simulate(kr5(), passive(), 83, poses=10).measured)
    assert done.fit.converged
    assert 'told worst' not in done.fit.reason
