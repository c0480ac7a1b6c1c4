# SPDX-License-Identifier: Apache-2.0
"""Encoder harmonics and compliance are found where they are, and refused where they are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from simulated_calibration import Scene, active, kr5, passive, simulate
from simulated_joint_errors import KINDS, LINKS, off_by, parts, true_errors

from calib_model.errors import DataError
from calib_model.kinematics import JointErrors, JointTerms, identifiable_table, points
from calib_solver.error_models.joint_errors import chosen_kinds, table_with
from calib_solver.fitting import AUTO, Options
from calib_solver.identification import identify
from calib_solver.problem import Problem, accumulate, point_jacobian
from calib_solver.quality import assess, probed_points
from calib_solver.resampling import exact_centers

pytestmark = pytest.mark.timeout(60)
ALL = Options(joint_errors=KINDS, links=LINKS)


@pytest.fixture(scope='module')
def plain() -> Scene:
    """Seven locations, without noise and without joint errors; the seventh is held out."""
    return simulate(kr5(), active(), 81, locations=7, poses=20)


@pytest.fixture(scope='module')
def bent(plain: Scene) -> Scene:
    return off_by(plain, true_errors())


@pytest.fixture(scope='module')
def done(bent: Scene):
    return identify(parts(bent)[0], ALL)


@pytest.mark.slow
def test_both_kinds_are_identified_and_help_where_nothing_was_fitted(bent, done):
    assert set(done.joint_error_choice.accepted) == set(KINDS)
    seen, unseen = parts(bent)
    bare = identify(seen)
    before = assess(unseen, bare.arm, bare.probe)
    after = assess(unseen, done.arm, done.probe, done.model)
    assert after.spheres.two_sigma.mean() < 0.5 * before.spheres.two_sigma.mean()
    assert after.distance.mean() < 0.5 * before.distance.mean()
    assert done.fit.converged


def test_the_truth_lies_within_the_stated_uncertainty(done):
    truth = true_errors().values.reshape(-1)
    names = done.table.names[done.table.mount.stop :]
    ratios = []
    for name, value in zip(names, truth, strict=True):
        column = done.table.column(name)
        if done.table.parameters[column].free:
            place = int(np.flatnonzero(done.table.free_columns == column)[0])
            sure = done.uncertainty.standard[place]
            assert sure > 0
            ratios.append((done.full[column] - value) / sure)
    assert len(ratios) == 24 + 5
    assert np.sqrt(np.mean(np.square(ratios))) < 1.6
    assert np.abs(ratios).max() < 4.5


def test_a_joint_that_gravity_does_not_turn_has_no_compliance_to_tell(done):
    parameter = done.table.parameters[done.table.column('compliance_1')]
    assert not parameter.free
    assert parameter.reason == 'compliance_1: gravity does not turn joint 1'
    assert done.full[done.table.column('compliance_1')] == 0.0


def test_the_fit_and_the_quality_are_of_one_model(done):
    assert done.identified.phi == pytest.approx(done.fit.quadratic.phi, rel=1e-9)
    model = done.model
    q, p_flange = done.problem.joints, done.probe.flange_T_probe.apply(done.problem.centers)
    expected = points(done.arm, q + model.joint_errors.angles(done.arm, q), p_flange)
    found = probed_points(done.problem, done.arm, done.probe, model)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)
    exact = replace(done.problem, centers=exact_centers(done))
    assert assess(exact, done.arm, done.probe, model).phi < 1e-8 * done.identified.phi


@pytest.mark.slow
def test_only_the_kind_that_is_there_is_identified(plain):
    for kind in KINDS:
        seen, _ = parts(off_by(plain, true_errors((kind,), 2.0)))
        assert identify(seen, ALL).joint_error_choice.accepted == (kind,)


@pytest.mark.slow
@pytest.mark.parametrize('probe', [active(), passive()])
def test_an_arm_whose_only_errors_are_geometric_gets_none(plain, probe):
    scene = plain if probe.kind == 'active' else simulate(kr5(), probe, 82, locations=6)
    nothing = JointErrors(JointTerms(2), np.zeros((4, 6)))
    measured = off_by(scene, nothing).measured
    bare, found = identify(measured), identify(measured, ALL)
    assert found.joint_error_choice.accepted == ()
    assert len(found.joint_error_choice.tried) == 2
    assert all('refused' in line for line in found.joint_error_choice.lines)
    assert found.model is None
    np.testing.assert_array_equal(found.full, bare.full)


def test_columns_are_what_differences_say(bent):
    """Every column but for what compliance itself changes with D-H, which is left out."""
    problem = Problem.of(bent.measured)
    rng = np.random.default_rng(9)
    for kinds, exact in ((('encoder',), True), (KINDS, False)):
        table = identifiable_table(bent.measured.arm, bent.measured.probe)
        table = table_with(table, problem.measured.arm, problem.joints, kinds, LINKS)
        full = table.nominal + 1e-4 * rng.normal(size=len(table.nominal))
        full[[i for i, p in enumerate(table.parameters) if p.kind == 'compliance']] *= 0.1
        rows = np.arange(0, len(problem.joints), 37)
        _, jacobian = point_jacobian(problem, table, full, rows)
        for column, parameter in enumerate(table.parameters):
            # a compliance comes with torques of some ten N m
            size = 1e-5 if parameter.kind == 'compliance' else 1e-4
            step = size * (np.arange(len(full)) == column)
            ahead, behind = (
                point_jacobian(problem, table, full + sign * step, rows)[0] for sign in (1, -1)
            )
            slope = (ahead - behind) / (2 * size)
            of_terms = parameter.kind in KINDS
            near = 1e-6 if exact or of_terms else 2e-3
            largest = max(np.abs(slope).max(), 1.0)
            np.testing.assert_allclose(
                jacobian[:, :, column], slope, rtol=0, atol=near * largest, err_msg=parameter.name
            )


def test_a_table_without_joint_errors_has_the_sums_it_had(plain):
    problem = Problem.of(plain.measured)
    table = identifiable_table(plain.measured.arm, plain.measured.probe)
    wider = table_with(table, problem.measured.arm, problem.joints, KINDS, LINKS)
    free = len(table.free_columns)
    narrow = accumulate(problem, table, table.nominal)
    wide = accumulate(problem, wider, wider.nominal)
    for name in ('center', 'spread'):
        np.testing.assert_allclose(getattr(wide, name), getattr(narrow, name), rtol=1e-9)
    np.testing.assert_allclose(wide.normal[:, :free, :free], narrow.normal, rtol=1e-7, atol=1e-9)


def test_too_few_locations_are_not_asked(plain):
    poses = plain.measured.poses
    few = replace(plain.measured, poses=poses.take(poses.location < 4))
    choice = identify(few, ALL).joint_error_choice
    assert choice.accepted == ()
    assert choice.lines == ['joint errors refused: 3 locations, expected 4 to judge them by']


def test_what_cannot_be_offered_is_refused_at_once(plain):
    with pytest.raises(
        DataError, match="no joint error 'backlash': expected one of auto, none, encoder"
    ):
        identify(plain.measured, Options(joint_errors=('backlash',)))
    with pytest.raises(DataError, match='masses of the links are not given'):
        identify(plain.measured, Options(joint_errors=('compliance',)))
    with pytest.raises(DataError, match='joint error scale: no joint of kr5 slides'):
        identify(plain.measured, Options(joint_errors=('scale',)))
    assert chosen_kinds(' encoder, compliance,encoder ') == ('encoder', 'compliance')
    assert chosen_kinds('') == chosen_kinds('auto') == (AUTO,)
    assert chosen_kinds('none') == ()
