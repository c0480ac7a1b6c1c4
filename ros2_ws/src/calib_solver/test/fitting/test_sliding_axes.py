# SPDX-License-Identifier: Apache-2.0
"""Arms with rails and coupled axes: all that shows is identified, what does not is named."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_calibration import (
    Scene,
    active,
    on_a_rail,
    passive,
    random_arm,
    scara_like,
    simulate,
    stanford,
    with_rail,
)
from simulated_joint_errors import off_by

from calib_model.instruments import Arm, PassiveProbe
from calib_model.kinematics import (
    JointErrors,
    JointTerms,
    forward_kinematics,
    identifiable_table,
)
from calib_model.urdf import arm_from_urdf, arm_urdf
from calib_solver.fitting import NO_PRIOR, Options
from calib_solver.identification import identify

ANYHOW = random_arm(np.random.default_rng(12))
ARMS = {
    'on a rail, with a coupled axis': on_a_rail(),
    'stanford': stanford(),
    'scara whose second axis slides along the first': with_rail(scara_like(), 1),
    'two rails': with_rail(with_rail(ANYHOW, 0), 1),
    'a rail before the flange': with_rail(ANYHOW, 5),
}


def told(arm: Arm, probe: PassiveProbe) -> int:
    """How many parameters a chain of turns and slides has that a seat shows: 4 for a turn and 2
    for a slide, less what no probing shows of base (6) and wrist, whose seat (3) has no turn."""
    turns = int((~arm.prismatic).sum())
    return 4 * turns + 2 * (arm.n - turns) + 6 - 6 - 3


@pytest.mark.slow
@pytest.mark.parametrize('name', ARMS)
@pytest.mark.parametrize('probe', [active(), passive()], ids=['active', 'passive'])
def test_unseen_points_come_out_exactly_without_noise_and_without_a_prior(name, probe):
    scene = simulate(ARMS[name], probe, 3, locations=4, poses=25)
    done = identify(scene.measured, Options(prior=NO_PRIOR, quick=True))
    assert done.fit.converged
    assert done.observability.rank == len(done.table.free)
    assert scene.prediction_error(scene.measured.arm, probe) > 1e-4
    assert scene.prediction_error(done.arm, done.probe) < 1e-9


@pytest.fixture(scope='module')
def railed() -> Scene:
    return simulate(on_a_rail(), active(), 6, locations=4, poses=25)


def test_an_arm_on_a_rail_loses_what_its_base_does_and_says_so():
    table = identifiable_table(on_a_rail(), passive())
    assert len(table.free) == told(on_a_rail(), passive())
    for name in ('a1', 'd1', 'd2', 'theta_0_1'):
        parameter = table.parameters[table.column(name)]
        assert not parameter.free
        assert 'the whole arm with its base frame' in parameter.reason
    assert table.parameters[table.column('alpha1')].free  # the rail's direction to what it carries
    assert table.parameters[table.column('theta_0_2')].free


def test_the_line_of_a_rail_in_between_is_named_with_what_tells_the_same():
    table = identifiable_table(stanford(), passive())
    reason = table.parameters[table.column('a2')].reason
    assert reason == 'a2 shows only together with a3, next to a joint that slides'
    assert table.parameters[table.column('d2')].free  # the shoulder's offset is no line of a rail


def test_poses_of_a_gauge_tell_the_scale_of_a_rail(railed: Scene):
    values = np.where(railed.true.prismatic, 2.4e-4, 0.0)
    scene = off_by(railed, JointErrors(JointTerms(scale=True), values[None]))
    done = identify(scene.measured, Options(joint_errors=('scale',)))
    assert done.joint_error_choice.accepted == ('scale',)
    found = next(one for one in done.estimates if one.parameter.name == 'scale_1')
    within = 4 * found.standard_uncertainty
    assert found.identifiable and within < 1e-4
    assert found.identified == pytest.approx(2.4e-4, abs=within)


def test_a_user_frees_such_a_parameter_all_the_same():
    table = identifiable_table(on_a_rail(), active(), free=['a1'])
    assert table.parameters[table.column('a1')].free


@pytest.mark.slow
def test_the_corrected_urdf_is_the_identified_arm_when_read_back(railed):
    done = identify(railed.measured, Options(quick=True))
    arm = done.arm
    again = arm_from_urdf(arm_urdf(arm), arm.base_frame, arm.flange_frame)
    q = np.random.default_rng(1).uniform(-2, 2, (40, arm.n))
    expected = forward_kinematics(arm, q)
    read = forward_kinematics(again, arm.uncoupled(q))
    np.testing.assert_allclose(read, expected, rtol=0, atol=1e-9)
