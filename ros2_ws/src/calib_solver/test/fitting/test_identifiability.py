# SPDX-License-Identifier: Apache-2.0
"""What is frozen by construction, why it says so, and what a user can fix or free."""

from __future__ import annotations

import numpy as np
import pytest
from simulated_calibration import (
    MOUNT,
    active,
    arm_of,
    iiwa,
    kr5,
    passive,
    scara_like,
    simulate,
    ur_like,
)

from calib_model.errors import DataError
from calib_model.instruments import PassiveProbe
from calib_model.kinematics import ParameterTable, identifiable_table
from calib_solver.fitting.options import Options
from calib_solver.identification import identify
from calib_solver.problem import Problem, point_jacobian

pytestmark = pytest.mark.timeout(60)

BASE = {'d1', 'theta_0_1'}
FLANGE = {'a6', 'alpha6', 'd6', 'theta_0_6'}


def crossed():
    """A 6R arm without parallel axes, as the FARO arm is: the chapter's 27 parameters."""
    quarter = np.pi / 2
    alpha = (-quarter, quarter, -quarter, quarter, -quarter, 0.0)
    return arm_of('crossed', [(0.01, alpha[i], 0.1 * i, 0.0) for i in range(6)])


def classic(table):
    """The parameters of the chapter: no beta."""
    return [p for p in table.parameters if p.kind != 'beta' and p.kind != 'probe_rotation']


def free_names(table):
    return {p.name for p in table.free}


def frozen_reasons(table):
    return {p.name: p.reason for p in table.parameters if not p.free}


def test_a_point_probe_on_six_crossing_axes_has_21_of_27_parameters_free():
    table = identifiable_table(crossed(), passive())
    assert len(classic(table)) == 27
    assert len(table.free) == 21
    frozen = {p.name for p in classic(table)} - free_names(table)
    assert frozen == BASE | FLANGE


def test_parallel_axes_hold_one_d_and_take_beta():
    table = identifiable_table(kr5(), passive())
    assert len([p for p in classic(table) if p.free]) == 20
    assert {p.name for p in classic(table)} - free_names(table) == BASE | FLANGE | {'d2'}
    assert free_names(table) - {p.name for p in classic(table)} == {'beta2'}


def test_an_active_probe_frees_its_rotation_too():
    passive_names = free_names(identifiable_table(kr5(), passive()))
    active_names = free_names(identifiable_table(kr5(), active()))
    assert active_names - passive_names == {'probe_rx', 'probe_ry', 'probe_rz'}


def test_seven_joints_leave_the_last_one_to_the_mount():
    table = identifiable_table(iiwa(), active())
    frozen = {p.name for p in classic(table)} - free_names(table)
    assert frozen == BASE | {'a7', 'alpha7', 'd7', 'theta_0_7'}


def test_axes_parallel_from_the_base_on_lose_every_d_to_the_base():
    table = identifiable_table(scara_like(), passive())
    assert {'d1', 'd2'} & free_names(table) == set()
    assert 'beta1' in free_names(table)


def test_three_parallel_axes_keep_one_d_of_three():
    table = identifiable_table(ur_like(), passive())
    assert free_names(table) & {'d2', 'd3', 'd4'} == {'d4'}
    assert {'beta2', 'beta3'} <= free_names(table)


@pytest.mark.parametrize(
    ('tilt', 'parallel'), [(0.0, True), (1.7e-4, True), (np.pi, True), (0.2, False)]
)
def test_nearly_and_oppositely_parallel_axes_count_as_parallel(tilt, parallel):
    names = free_names(identifiable_table(kr5(tilt), passive()))
    assert ('beta2' in names, 'd2' in names) == (parallel, not parallel)


def test_every_frozen_parameter_says_why_and_names_itself_or_its_axis():
    for probe in (active(), passive()):
        for name, reason in frozen_reasons(identifiable_table(kr5(), probe)).items():
            assert len(reason) > 20, name
            joint = name[-1]
            assert name in reason or f'axis {joint}' in reason or 'passive probe' in reason


def test_reasons_name_the_base_the_mount_and_the_parallel_axes():
    reasons = frozen_reasons(identifiable_table(kr5(), passive()))
    assert 'base frame' in reasons['d1']
    assert 'base frame' in reasons['theta_0_1']
    assert 'mount' in reasons['theta_0_6']
    assert 'axes 2 and 3 are parallel' in reasons['d2']
    assert 'd3' in reasons['d2']
    assert 'passive' in reasons['probe_rz']


@pytest.mark.slow
@pytest.mark.parametrize('probe', [active, passive])
@pytest.mark.parametrize('make', [crossed, kr5, iiwa, scara_like, ur_like])
def test_what_is_free_is_visible_and_what_is_frozen_is_not(make, probe):
    """By numbers: freezing loses no rank of the data, and leaves none of it out.

    The rank is that of all relative positions of postures taken anywhere, the most any probing
    could show.
    """
    arm = make()
    scene = simulate(arm, probe(), 31, locations=1, spheres=(8,), poses=2)
    generator = np.random.default_rng(2)
    problem = _anywhere(scene.measured, generator)
    table = identifiable_table(arm, scene.measured.probe)
    full = ParameterTable.of(arm, scene.measured.probe)
    every = np.arange(len(problem.joints))
    point, jacobian = point_jacobian(problem, full, full.nominal, every)
    slopes = jacobian.reshape(-1, jacobian.shape[2])
    seen = _without_base_motion(slopes, point)
    rank = np.linalg.matrix_rank(seen, tol=1e-9 * np.linalg.norm(seen, 2))
    free = seen[:, table.free_columns]
    free_rank = np.linalg.matrix_rank(free, tol=1e-9 * np.linalg.norm(seen, 2))
    assert rank == free_rank == len(table.free)


def _anywhere(measured, generator):
    """The problem with random joints, and a sphere anywhere in an active probe."""
    count = 400
    joints = generator.uniform(-3, 3, (count, measured.arm.n))
    center = generator.uniform(-1e-3, 1e-3, (count, 3))
    displacement = np.zeros((count, 3))
    if not isinstance(measured.probe, PassiveProbe):
        displacement = measured.probe.displacements(center, measured.gauge.sphere_diameter)
    poses = type(measured.poses).of(np.ones(count, int), np.full(count, 8), joints, displacement)
    return Problem.of(type(measured)(measured.arm, measured.probe, measured.gauge, poses))


def _without_base_motion(slopes, point):
    """Slopes (3N, P) less what a small rigid motion of all points (N, 3) would do as well."""
    motion = np.zeros((len(point), 3, 6))
    motion[:, :, :3] = np.eye(3)
    for axis in range(3):
        motion[:, :, 3 + axis] = np.cross(np.eye(3)[axis], point)
    basis = np.linalg.qr(motion.reshape(-1, 6))[0]
    return slopes - basis @ (basis.T @ slopes)


def test_patterns_fix_and_free_by_name():
    table = identifiable_table(kr5(), passive(), fix=('d*', 'a2'))
    assert not any(name.startswith('d') for name in free_names(table))
    assert frozen_reasons(table)['d4'] == 'fixed by the user'
    assert frozen_reasons(table)['a2'] == 'fixed by the user'
    assert 'a3' in free_names(table)


def test_freeing_comes_last_and_overrides_what_is_frozen_by_construction():
    table = identifiable_table(kr5(), passive(), fix=('d*',), free=('d4', 'theta_0_1'))
    assert {'d4', 'theta_0_1'} <= free_names(table)
    assert 'd5' not in free_names(table)


def test_brackets_and_question_marks_are_patterns_too():
    table = identifiable_table(kr5(), passive(), fix=('alpha[123]', 'probe_?'))
    assert {'alpha1', 'alpha2', 'alpha3', 'probe_x', 'probe_y', 'probe_z'} & free_names(
        table
    ) == set()
    assert 'alpha4' in free_names(table)


@pytest.mark.parametrize('keyword', ['fix', 'free'])
def test_a_pattern_that_matches_nothing_is_refused_with_the_names_there_are(keyword):
    with pytest.raises(DataError, match=r"'q\*'.*theta_0_1.*probe_rz"):
        identifiable_table(kr5(), passive(), **{keyword: ('q*',)})


def test_what_is_frozen_keeps_its_nominal_value_to_the_bit(active_scene):
    done = identify(active_scene.measured, Options(fix=('alpha*', 'probe_x')))
    for parameter, value in zip(done.table.parameters, done.full, strict=True):
        assert parameter.free or value == parameter.nominal
    np.testing.assert_array_equal(done.arm.geometry[1], active_scene.measured.arm.geometry[1])
    assert done.probe.flange_T_probe.translation[0] == MOUNT.translation[0]


@pytest.mark.slow
def test_fixing_everything_leaves_the_arm_as_it_was(active_scene):
    done = identify(active_scene.measured, Options(fix=('*',)))
    assert done.arm.geometry.tolist() == active_scene.measured.arm.geometry.tolist()
    assert done.identified.phi == done.initial.phi


@pytest.mark.slow
@pytest.mark.parametrize('which', ['clean_scene', 'active_scene', 'passive_scene'])
@pytest.mark.parametrize('name', ['d1', 'theta_0_1'])
def test_a_freed_parameter_that_nothing_shows_is_not_called_identifiable(name, which, request):
    """In noisy data a turn of the base turns the residuals, and looks seen to the numbers."""
    scene = request.getfixturevalue(which)
    done = identify(scene.measured, Options(free=(name,)))
    told = {estimate.parameter.name: estimate for estimate in done.estimates}
    assert told[name].parameter.free
    assert not told[name].identifiable
    assert told[name].standard_uncertainty is None
    assert 'base frame' in told[name].reason
    assert told['a2'].identifiable
    assert abs(told[name].identified - told[name].parameter.nominal) < 1e-2
    assert done.identified.phi < done.initial.phi / 100


def test_the_numbers_alone_see_a_freed_lift_of_the_base(passive_scene):
    done = identify(passive_scene.measured, Options(free=('d1',)))
    reasons = dict(zip([p.name for p in done.table.free], done.observability.reason, strict=True))
    assert reasons['d1']
    assert reasons['a2'] == ''
    assert done.observability.rank == len(done.fit.x) - 1
