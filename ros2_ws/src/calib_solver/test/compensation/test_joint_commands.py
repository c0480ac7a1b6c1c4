# SPDX-License-Identifier: Apache-2.0
"""Compensated commands bring the real tool to its targets; Pinocchio and differences agree."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from simulated_calibration import (
    Scene,
    active,
    aligned,
    iiwa,
    kr5,
    on_a_rail,
    passive,
    perturbed,
    simulate,
    turned_kr5,
    ur_like,
)

from calib_model.bags import write_measurement
from calib_model.errors import CalibrationError, DataError, TableError
from calib_model.instruments import Arm
from calib_model.kinematics import (
    Correction,
    JointErrors,
    JointTerms,
    Shift,
    forward_kinematics,
    points,
    tool_motion,
)
from calib_model.transforms import RigidTransform, rotation_vector
from calib_model.urdf import arm_urdf
from calib_solver.commands.compensate import main
from calib_solver.commands.identify import run as run_identify
from calib_solver.compensation.calibrated_arm import Calibrated, read_calibrated, tip
from calib_solver.compensation.inverse_kinematics import EXACT, Targets, reach
from calib_solver.compensation.joint_commands import (
    CompensationError,
    compensate_joints,
    compensate_targets,
)
from calib_solver.compensation.path import path_notes
from calib_solver.compensation.tables import rows_of, with_tool
from calib_solver.compensation.target_table import TargetTable, read_targets
from calib_solver.identification import identify
from calib_solver.identified import Identification

pytestmark = pytest.mark.timeout(60)
TOOL = RigidTransform(np.array([0.02, -0.01, 0.12]), np.array([0.3, -0.5, 0.2]))
LIMITED = 2.8


def limited(arm: Arm) -> Arm:
    joints = tuple(replace(joint, limits=(-LIMITED, LIMITED)) for joint in arm.joints)
    return replace(arm, joints=joints)


def off(arm: Arm, seed: int = 0) -> Calibrated:
    """An arm whose real parameters are off, and its tool too."""
    rng = np.random.default_rng(seed)
    real = perturbed(arm, rng)
    tool = RigidTransform(TOOL.translation + 1e-3, TOOL.rotation_vector + 2e-3)
    return Calibrated(arm, real, TOOL, tool)


ARMS = {
    'kr5': kr5(),
    'turned': turned_kr5(),
    'iiwa': iiwa(),
    'ur': ur_like(),
    'rail': on_a_rail(),
}


@pytest.mark.parametrize('name', ARMS)
def test_the_tools_jacobian_is_pinocchios_and_the_finite_difference(name: str) -> None:
    arm = replace(ARMS[name], base_T_dh=TOOL, dh_T_flange=TOOL.inverse())
    q = np.random.default_rng(0).uniform(-2, 2, (5, arm.n))
    motion = tool_motion(arm, q, TOOL)
    model = pinocchio.buildModelFromXML(arm_urdf(arm))
    flange = model.getFrameId(arm.flange_frame)
    tool = model.addFrame(
        pinocchio.Frame(
            'tool',
            model.frames[flange].parentJoint,
            flange,
            model.frames[flange].placement * pinocchio.SE3(TOOL.matrix()),
            pinocchio.FrameType.OP_FRAME,
        )
    )
    data = model.createData()
    for row, jacobian, position, rotation in zip(
        q, motion.jacobian, motion.position, motion.rotation, strict=True
    ):
        expected = pinocchio.computeFrameJacobian(
            model, data, arm.uncoupled(row)[0], tool, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        expected = arm.by_positions(expected)
        np.testing.assert_allclose(jacobian, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(position, data.oMf[tool].translation, rtol=0, atol=1e-12)
        for i, step in enumerate(1e-6 * np.eye(arm.n)):
            ahead, behind = (tool_motion(arm, row + way * step, TOOL) for way in (1, -1))
            linear = (ahead.position - behind.position)[0] / 2e-6
            turn = rotation_vector(ahead.rotation[0] @ behind.rotation[0].T) / 2e-6
            np.testing.assert_allclose(jacobian[:, i], [*linear, *turn], rtol=0, atol=1e-8)
        assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize('name', ARMS)
def test_a_trajectory_puts_the_real_tool_where_the_nominal_one_would_be(name: str) -> None:
    calibrated = off(ARMS[name])
    q = np.random.default_rng(1).uniform(0.4, 1.2, (200, calibrated.nominal.n))
    q *= calibrated.nominal.direction  # else some stretch the arm out
    q = calibrated.nominal.coupled(q)
    done = compensate_joints(calibrated, q)
    wanted = forward_kinematics(calibrated.nominal, q) @ TOOL.matrix()
    real = (
        forward_kinematics(calibrated.identified, done.joints) @ calibrated.identified_tool.matrix()
    )
    np.testing.assert_allclose(real, wanted, rtol=0, atol=1e-9)
    assert np.abs(done.joints - q).max() < 0.3
    assert 1e-4 < done.miss.mean() < 1e-2
    np.testing.assert_array_equal(done.nominal, q)


def test_an_arm_with_joints_to_spare_changes_the_least() -> None:
    """At the least change, what was changed has no part along the joints' free motion."""
    calibrated = off(iiwa())
    q = np.random.default_rng(2).uniform(0.4, 1.2, (20, 7))
    for position_only, free in ((False, 1), (True, 4)):
        done = compensate_joints(calibrated, q, position_only)
        motion = tool_motion(calibrated.identified, done.joints, calibrated.identified_tool)
        rows = 3 if position_only else 6
        for change, jacobian in zip(done.joints - q, motion.jacobian[:, :rows], strict=True):
            null = np.linalg.svd(jacobian)[2][rows:]
            assert len(null) == free
            assert np.abs(null @ change).max() < 1e-7
            assert np.linalg.norm(change) > 1e-5


@cache
def calibration() -> tuple[Scene, Identification]:
    scene = simulate(limited(kr5()), active(), 4, locations=7, poses=20, noise=2e-5)
    return scene, identify(scene.measured)


def mean_error(reached: np.ndarray, targets: np.ndarray) -> float:
    return float(np.linalg.norm(aligned(reached, targets) - targets, axis=1).mean())


def test_500_targets_are_reached_as_surely_as_the_calibration_says() -> None:
    """Of all points but where they stand together, which is the base's and never shows."""
    scene, done = calibration()
    nominal = scene.measured.arm
    calibrated = Calibrated(nominal, done.arm, tip(scene.measured.probe), tip(done.probe))
    rng = np.random.default_rng(5)
    q = rng.uniform(-2.5, 2.5, (1000, 6))
    # not where the arm is stretched out: what the nominal one just reaches the real one may not
    able = np.linalg.svd(tool_motion(nominal, q, calibrated.nominal_tool).jacobian[:, :3])[1]
    q = q[able[:, 2] > 0.05][:500]
    assert len(q) == 500
    targets = points(nominal, q, calibrated.nominal_tool.translation)
    answer = compensate_targets(calibrated, Targets(targets), q)
    before, after = (
        mean_error(points(scene.true, joints, scene.mount.translation), targets)
        for joints in (answer.nominal, answer.joints)
    )
    covariance = done.uncertainty.covariance
    expected = []
    for offsets in rng.multivariate_normal(np.zeros(len(covariance)), covariance, 30):
        full = done.full.copy()
        full[done.table.free_columns] += offsets
        arm, probe = done.table.apply(full, nominal, done.probe)
        drawn = points(arm, answer.joints, probe.flange_T_probe.translation)
        expected.append(mean_error(drawn, targets))
    assert after < 1.5 * np.mean(expected)
    assert before > 20 * after


@pytest.mark.slow
def test_targets_with_an_orientation_are_reached_from_anywhere_within_the_limits() -> None:
    calibrated = off(limited(kr5()))
    q = np.random.default_rng(6).uniform(-1.5, 1.5, (60, 6))
    wanted = forward_kinematics(calibrated.nominal, q) @ TOOL.matrix()
    done = compensate_targets(calibrated, Targets(wanted[:, :3, 3], wanted[:, :3, :3]))
    real = (
        forward_kinematics(calibrated.identified, done.joints) @ calibrated.identified_tool.matrix()
    )
    np.testing.assert_allclose(real, wanted, rtol=0, atol=1e-9)
    assert calibrated.identified.within_limits(done.joints, -1e-8).all()
    nominal = forward_kinematics(calibrated.nominal, done.nominal) @ TOOL.matrix()
    np.testing.assert_allclose(nominal, wanted, rtol=0, atol=1e-9)


def test_what_was_found_beyond_the_d_h_parameters_is_made_good_too() -> None:
    rng = np.random.default_rng(8)
    turn = JointErrors(JointTerms(2), 5e-4 * rng.normal(size=(4, 6)))
    shift = Shift(2e-4 * rng.normal(size=(2, 3, 6)))
    arm = limited(kr5())
    correction = Correction(arm.joint_names, turn, None, shift)
    calibrated = replace(off(arm), correction=correction)
    q = rng.uniform(0.4, 1.2, (50, 6))
    wanted = tool_motion(arm, q, TOOL)
    joints = compensate_joints(calibrated, q).joints
    real = calibrated.identified
    there = tool_motion(real, correction.joints(real, joints), calibrated.identified_tool)
    at = there.position + correction.shifts(real, joints)
    np.testing.assert_allclose(at, wanted.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(there.rotation, wanted.rotation, rtol=0, atol=1e-9)
    plain = compensate_joints(replace(calibrated, correction=None), q).joints
    assert np.abs(plain - joints).max() > 1e-4


def test_limits_are_kept_by_the_joints_that_are_free_to_make_up_for_it() -> None:
    arm = iiwa()
    q = np.random.default_rng(7).uniform(0.4, 1.2, (30, 7))
    calibrated = off(arm)
    changed = compensate_joints(calibrated, q).joints
    joint = 2
    assert (changed[:, joint] > q[:, joint]).any()
    joints = list(calibrated.identified.joints)
    held = 0
    for row in np.flatnonzero(changed[:, joint] > q[:, joint]):
        upper = float((q[row, joint] + changed[row, joint]) / 2)
        joints[joint] = replace(joints[joint], limits=(-3.0, upper))
        tight = replace(calibrated, identified=replace(calibrated.identified, joints=tuple(joints)))
        done = compensate_joints(tight, q[row : row + 1])
        assert done.joints[0, joint] == pytest.approx(upper, abs=1e-12)
        found = tool_motion(tight.identified, done.joints, tight.identified_tool)
        wanted = tool_motion(arm, q[row : row + 1], TOOL)
        np.testing.assert_allclose(found.position, wanted.position, rtol=0, atol=1e-9)
        held += 1
    assert held > 3


@pytest.mark.slow
def test_what_is_not_reached_is_named_with_its_row() -> None:
    calibrated = off(limited(kr5()))
    far = np.array([[0.4, 0.1, 0.4], [1.4, 0.0, 0.3]])
    done = compensate_targets(calibrated, Targets(far))
    assert list(done.unreached) == [1]
    assert done.unreached[1].startswith('row 2: kr5 does not get to (1.4000, 0.0000')
    assert np.isfinite(done.joints[0]).all()
    assert np.isnan(done.joints[1]).all()
    with pytest.raises(CompensationError, match=r'row 1: kr5 does not get to \(1.4000, 0.0000'):
        compensate_targets(calibrated, Targets(far[1:]))
    q = np.full((3, 6), 0.8)
    change = compensate_joints(calibrated, q).joints[2, 2] - 0.8
    upper = 0.8 + change / 2 if change > 0 else LIMITED
    lower = 0.8 + change / 2 if change < 0 else -LIMITED
    joints = list(calibrated.identified.joints)
    joints[2] = replace(joints[2], limits=(lower, upper))
    tight = replace(calibrated, identified=replace(calibrated.identified, joints=tuple(joints)))
    with pytest.raises(CompensationError, match=r'row 1: .* joint_a3 would pass its limits'):
        compensate_joints(tight, q)
    with pytest.raises(DataError, match='expected 6 joint positions, got 7'):
        compensate_joints(calibrated, np.zeros((1, 7)))


def wrist_program(first: float, last: float, seed: int) -> np.ndarray:
    """A smooth program of 150 rows whose wrist angle goes from `first` to `last` degrees."""
    rng = np.random.default_rng(seed)
    begin = np.array([0.2, -1.1, 1.2, 0.3, np.radians(first), 0.1])
    end = begin + rng.uniform(-0.2, 0.2, 6)
    end[4] = np.radians(last)
    return begin + np.linspace(0, 1, 150)[:, None] * (end - begin)


@pytest.mark.parametrize('first, last', [(8, -6), (25, 0.4), (-4, 4), (0.2, 30), (0, 0)])
@pytest.mark.parametrize('correction', [False, True])
def test_a_smooth_program_stays_smooth_through_the_wrists_singularity(first, last, correction):
    arm = limited(kr5())
    calibrated = off(arm, seed=3)
    if correction:
        turn = JointErrors(JointTerms(2), 2e-4 * np.random.default_rng(4).normal(size=(4, 6)))
        calibrated = replace(calibrated, correction=Correction(arm.joint_names, turn))
    q = wrist_program(first, last, seed=int(first) % 5)
    done = compensate_joints(calibrated, q)
    own, step = (np.abs(np.diff(rows, axis=0)).max(axis=1) for rows in (q, done.joints))
    assert (step < 2 * own + 0.02).all()
    assert not done.unreached
    # what is given up is small against what the nominal commands miss, and told
    assert done.left.max() < 0.7 * done.miss.max()
    away, turn_away = done.left > 1e-8, done.left_turn > 1e-8
    np.testing.assert_array_equal(done.held, np.flatnonzero(away | turn_away))
    free = np.abs(np.degrees(q[:, 4])) > 20
    assert not free[done.held].any()


def test_rows_that_are_no_path_are_reached_exactly():
    calibrated = off(kr5())
    q = np.random.default_rng(9).uniform(0.2, 1.2, (40, 6))
    q[::2, 4] = 0.05
    done = compensate_joints(calibrated, q)
    assert not len(done.held)


def test_targets_along_a_path_are_answered_in_one_branch():
    calibrated = off(limited(kr5()))
    q = wrist_program(60, 40, 1)
    wanted = forward_kinematics(calibrated.nominal, q) @ TOOL.matrix()
    done = compensate_targets(calibrated, Targets(wanted[:, :3, 3], wanted[:, :3, :3]))
    assert np.abs(np.diff(done.joints, axis=0)).max() < 0.05


def test_steps_that_are_too_fast_are_named_with_their_lines():
    calibrated = off(kr5())
    slow = tuple(replace(joint, velocity=2.0) for joint in calibrated.identified.joints)
    arm = replace(calibrated.identified, joints=slow)
    q = np.full((4, 6), 0.8)
    q[2:, 1] += 0.5
    time = np.array([0.0, 1.0, 1.1, 1.1])
    table = TargetTable('p.csv', (2, 3, 5, 6), None, None, q, time)
    notes = path_notes(arm, compensate_joints(calibrated, q), table)
    assert notes[0] == 'p.csv, lines 5 to 6: time does not go on'
    assert notes[1].startswith('p.csv, lines 3 to 5: joint_a2 would have to turn at 5')
    assert notes[1].endswith('rad/s, it can 2')
    assert path_notes(arm, compensate_joints(calibrated, q), replace(table, time=None)) == ()


def test_one_target_out_of_reach_costs_its_row_alone(result, tmp_path, capsys):
    table, out = tmp_path / 'targets.csv', tmp_path / 'joints.csv'
    table.write_text('x,y,z\n0.4,0.1,0.4\n9,9,9\n0.4,0.12,0.4\n')
    assert main([str(result), str(table), str(out)]) == 1
    told = capsys.readouterr()
    assert 'line 3: kr5 does not get to (9.0000' in told.err
    assert '2 targets' in told.out
    assert '1 more not reached' in told.out
    joints = np.loadtxt(out, delimiter=',', skiprows=1)
    assert np.isnan(joints).any(axis=1).tolist() == [False, True, False]


def test_stretched_out_beyond_reach_is_no_answer() -> None:
    arm = kr5()
    found = reach(arm, RigidTransform(), Targets(np.array([[2.0, 0, 0]])), np.full((1, 6), 0.3))
    assert not found.arrived.any()
    assert found.miss[0] > 0.5 > EXACT


@pytest.fixture(scope='module')
def result(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that `identify` writes, passive probe."""
    folder = tmp_path_factory.mktemp('result')
    scene = simulate(limited(kr5()), passive(), 3, locations=3, poses=8, noise=1e-5)
    write_measurement(folder / 'bag', scene.measured)
    run_identify([str(folder / 'bag'), '--output', str(folder / 'out')])
    return folder / 'out'


def test_a_results_folder_holds_both_arms(result: Path) -> None:
    calibrated = read_calibrated(result)
    nominal = limited(kr5())
    np.testing.assert_array_equal(calibrated.nominal.geometry, nominal.geometry)
    assert np.abs(calibrated.identified.geometry - nominal.geometry).max() > 1e-5
    probe = passive()
    np.testing.assert_allclose(
        calibrated.nominal_tool.translation, probe.flange_T_probe.apply(probe.center), atol=1e-15
    )
    with pytest.raises(CalibrationError, match='cannot be read'):
        read_calibrated(result / 'no')


@pytest.mark.parametrize(
    ('header', 'rows'),
    [
        ('x,y,z', '0.45,0.1,0.4\n0.4,-0.2,0.3\n'),
        ('X, Y, Z, rx, ry, rz', '0.45,0.1,0.4,0,1.5,0\n\n# so\n0.4,-0.2,0.3,0,1.5,0\n'),
        ('time,qx,qy,qz,qw,x,y,z', '0,0,0.6,0,0.8,0.45,0.1,0.4\n1,0,0.6,0,0.8,0.4,-0.2,0.3\n'),
        ('q1,q2,q3,q4,q5,q6,time', '.1,.2,.3,.4,.5,.6,0\n.2,.3,.4,.5,.6,.7,0.5\n'),
        ('x,y,z,q1,q2,q3,q4,q5,q6', '.45,.1,.4,0,0,0,0,1,0\n.4,-.2,.3,0,0,0,0,1,0\n'),
    ],
)
def test_the_command_answers_a_table_with_a_table(
    header: str, rows: str, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table, out = tmp_path / 'targets.csv', tmp_path / 'joints.csv'
    table.write_text(f'{header}\n{rows}')
    assert main([str(result), str(table), str(out)]) == 0
    assert '2 targets: the nominal commands would miss by' in capsys.readouterr().out
    calibrated = read_calibrated(result)
    asked, answered = read_targets(table, 6), read_targets(out, 6)
    assert answered.joints is not None
    found = tool_motion(calibrated.identified, answered.joints, calibrated.identified_tool)
    wanted = asked.position
    if wanted is None:
        assert asked.joints is not None
        wanted = tool_motion(calibrated.nominal, asked.joints, calibrated.nominal_tool).position
    np.testing.assert_allclose(found.position, wanted, rtol=0, atol=1e-9)
    if asked.rotation is not None:
        np.testing.assert_allclose(found.rotation, asked.rotation, rtol=0, atol=1e-9)
    if asked.time is not None:
        np.testing.assert_array_equal(answered.time, asked.time)


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        ('x,y\n1,2\n', "no column 'z' beside 'x'"),
        ('x,y,z,q7\n1,2,3,4\n', "column 'q7' is unknown for an arm of 6 joints"),
        ('x,y,z,x\n1,2,3,4\n', "column 'x' is there twice"),
        ('x,y,z\n1,2\n', 'line 2: expected 3 columns as in the header line, got 2'),
        ('x,y,z\n1,2,inf\n', "line 2, column z: expected a number, got 'inf'"),
        ('time,x,y,z\n1e9,1,2,1e308\n', 'column z: expected 10000 m or rad at most, got 1e.308'),
        ('x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,2\n', 'line 2: expected a quaternion of length 1, got 2'),
        ('rx,ry,rz\n1,2,3\n', 'no columns of positions or joints'),
        ('x,y,z\n', 'no rows below a header line'),
        ('x,y,z\n9,9,9\n', r'line 2: kr5 does not get to \(9.0000'),
    ],
)
def test_a_table_that_cannot_be_used_is_one_line_and_nothing_is_written(
    text: str, problem: str, result: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    table, out = tmp_path / 'targets.csv', tmp_path / 'joints.csv'
    table.write_text(text)
    assert main([str(result), str(table), str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(str(table))
    assert error.count('\n') == 1
    with pytest.raises(CalibrationError, match=problem):
        raise TableError(error)
    assert not out.exists()


def test_another_tool_has_one_place_on_the_flange() -> None:
    calibrated = off(kr5())
    assert with_tool(calibrated, 'probe') is calibrated
    assert with_tool(calibrated, 'flange').identified_tool.is_identity
    given = with_tool(calibrated, '0.1,0,0.2')
    assert given.nominal_tool == given.identified_tool == RigidTransform(np.array([0.1, 0, 0.2]))
    for wrong in ('hand', '1,2', '1,2,nan'):
        with pytest.raises(CalibrationError, match=f"no tool '{wrong}'"):
            with_tool(calibrated, wrong)


def test_rows_that_do_not_go_together_are_refused() -> None:
    none, three, six = np.zeros(0), np.zeros(3), np.zeros(6)
    assert rows_of(6, three, none, none).position is not None
    assert rows_of(6, none, none, six).joints is not None
    for rows, problem in (
        ((none, none, none), 'no table, no position and no joint_position'),
        ((none, three, six), 'no table, no position'),
        ((six, three, none), 'rotation_vector: expected 2 rows of 3 numbers, got 3'),
        ((none, none, three), 'joint_position: expected rows of 6 numbers, got 3'),
        ((three * np.nan, none, none), r'position: expected numbers up to 10000 \(m or rad\)'),
        ((none, none, six + 1e308), 'joint_position: expected numbers up to 10000'),
    ):
        with pytest.raises(DataError, match=problem):
            rows_of(6, *rows)
