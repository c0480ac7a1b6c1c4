# SPDX-License-Identifier: Apache-2.0
"""D-H from any serial URDF: held against Pinocchio's reading of the same file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from urdf_files import PUBLIC, joint_text, public_urdf, random_urdf, through_pinocchio

from calib_model.commands.arm_from_urdf import main
from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import DescriptionError
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics, parallel_joints
from calib_model.urdf.export_arm import arm_urdf
from calib_model.urdf.import_arm import arm_from_urdf

pytestmark = pytest.mark.timeout(60)
EXACT = 1e-9


def off(arm: Arm, text: str, seed: int = 0, count: int = 20) -> float:
    """The largest difference of any element of T_base_flange to Pinocchio's, m."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (count, arm.n))
    expected = through_pinocchio(text, arm.base_frame, arm.flange_frame, arm.joint_names, q)
    return float(np.abs(forward_kinematics(arm, q) - expected).max())


@pytest.mark.parametrize('name', PUBLIC)
def test_public_arms_stand_where_pinocchio_puts_them(name: str) -> None:
    path, base, flange = public_urdf(name)
    text = path.read_text()
    arm = arm_from_urdf(path.read_bytes(), base, flange, name)
    assert off(arm, text, count=200) < EXACT
    assert (arm.base_frame, arm.flange_frame) == (base, flange)


@pytest.mark.slow
@settings(max_examples=80)
@given(seed=st.integers(0, 2**32 - 1), joints=st.integers(1, 4))
def test_any_serial_chain_is_an_arm(seed: int, joints: int) -> None:
    text = random_urdf(np.random.default_rng(seed), joints)
    arm = arm_from_urdf(text, '', '', 'random')
    assert off(arm, text, seed) < EXACT
    # where axes are not parallel there is no beta: freedom and description mean the same ones
    unparallel = [i for i in range(arm.n) if i + 1 not in parallel_joints(arm)]
    assert not arm.geometry[4, unparallel].any()


def test_our_own_urdf_comes_back_as_the_same_arm(arms: list[Arm], odd_arm: Arm) -> None:
    q = np.random.default_rng(0).uniform(-3, 3, (20, 7))
    for arm in (*arms, odd_arm):
        again = arm_from_urdf(arm_urdf(arm), arm.base_frame, arm.flange_frame, arm.name)
        assert again.joint_names == arm.joint_names
        np.testing.assert_allclose(
            forward_kinematics(again, arm.uncoupled(q[:, : arm.n])),
            forward_kinematics(arm, q[:, : arm.n]),
            rtol=0,
            atol=EXACT,
        )


def test_ur5_has_its_makers_lengths_and_two_hayati_angles() -> None:
    path, base, flange = public_urdf('ur5')
    arm = arm_from_urdf(path.read_bytes(), base, flange, 'ur5')
    a, alpha, d, _, beta = arm.geometry
    np.testing.assert_allclose(a, [0, 0.425, 0.39225, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(d, [0.089159, 0, 0, 0.10915, 0.09465, 0.0823], atol=1e-9)
    np.testing.assert_allclose(np.cos(alpha), [0, 1, 1, 0, 0, 1], atol=1e-9)
    assert parallel_joints(arm) == [2, 3]
    assert arm.dh_T_flange.is_identity
    assert not beta.any()


def test_limits_speeds_and_names_are_the_urdfs(kr5: Arm) -> None:
    arm = arm_from_urdf(arm_urdf(kr5), '', '', 'kr5')
    assert arm.joint_names == kr5.joint_names
    np.testing.assert_array_equal(arm.limits, kr5.limits)
    np.testing.assert_array_equal(arm.velocity, kr5.velocity)
    panda, base, flange = public_urdf('kinova_j2s6s200')
    continuous = arm_from_urdf(panda.read_bytes(), base, flange, 'kinova').joints[0]
    assert continuous.limits == (-np.inf, np.inf)


def test_the_command_writes_a_description_that_loads(tmp_path: Path, kr5: Arm) -> None:
    urdf, out = tmp_path / 'my.urdf', tmp_path / 'my.yaml'
    urdf.write_text(arm_urdf(replace(kr5, name='the <arm>')))
    given = [str(urdf), '--base', 'base_link', '--flange', 'tool0', str(out)]
    assert main(given) == 0
    arm = read_description(out, parse_arm)
    assert arm.name == 'the <arm>'
    assert off(arm, urdf.read_text()) < EXACT
    assert main([*given, '--name', 'mine']) == 0
    assert read_description(out, parse_arm).name == 'mine'


AXIS = '    <axis xyz="0 0 1"/>\n'
LIMIT = '    <limit lower="-1" upper="1" velocity="1" effort="1"/>\n'
TURN = joint_text('turn', 'revolute', 'base', 'a', '', AXIS + LIMIT)
PLANAR = joint_text('slide', 'planar', 'a', 'b', '', AXIS + LIMIT)
FIXED = joint_text('rigid', 'fixed', 'a', 'b')
SIDE = joint_text('side', 'fixed', 'a', 'c')


def robot(*joints: str, links: str = 'base a b c') -> str:
    body = ''.join(f'<link name="{name}"/>' for name in links.split())
    return f'<robot name="r">{body}{"".join(joints)}</robot>'


@pytest.mark.parametrize(
    ('text', 'base', 'flange', 'problem'),
    [
        (robot(TURN, PLANAR, SIDE), '', 'b', "joint 'slide': planar: expected revolute"),
        (robot(TURN, FIXED, SIDE), '', '', r'2 links are its end \(b, c\): name one by --flange'),
        (robot(TURN, FIXED), '', '', r'2 links are its root \(base, c\): name one by --base'),
        (robot(TURN, FIXED, SIDE), 'b', 'c', "no joints lead from link 'b' to 'c'"),
        (robot(TURN, FIXED, SIDE), 'base', 'tool0', r"no link 'tool0' \(there are base, a, b, c\)"),
        (robot(FIXED, SIDE, links='a b c'), '', 'b', "no joint moves between 'a' and 'b'"),
        (robot(TURN, FIXED, SIDE, SIDE), '', 'b', "joint 'side': link 'c' has a joint already"),
        (robot(TURN.replace('0 0 1', '0 0 0'), FIXED, SIDE), '', 'b', 'an axis that is not zero'),
        (robot(TURN.replace('0 0 1', '0 1'), FIXED, SIDE), '', 'b', "expected 3 .*, got '0 1'"),
        (robot(TURN.replace('"-1"', '"2"'), FIXED, SIDE), '', 'b', 'lower < upper'),
        (robot(TURN.replace(AXIS, AXIS + '<mimic joint="x"/>')), 'base', 'a', 'follows another'),
        (robot('<x:macro xmlns:x="http://wiki.ros.org/xacro"/>'), '', '', 'is xacro'),
        ('<sdf/>', '', '', r'expected a <robot>, got <sdf>'),
        ('<robot', '', '', 'not XML'),
    ],
)
def test_what_is_no_serial_arm_is_refused_in_one_line(
    text: str, base: str, flange: str, problem: str
) -> None:
    with pytest.raises(DescriptionError, match=problem) as refused:
        arm_from_urdf(text, base, flange, 'my.urdf')
    assert str(refused.value).startswith('my.urdf: ')
    assert '\n' not in str(refused.value)


def test_a_missing_file_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main([str(tmp_path / 'no.urdf'), str(tmp_path / 'out.yaml')]) == 2
    assert 'no.urdf: cannot be read: No such file' in capsys.readouterr().err
    assert not (tmp_path / 'out.yaml').exists()
