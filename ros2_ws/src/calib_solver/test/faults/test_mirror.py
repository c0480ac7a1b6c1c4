# SPDX-License-Identifier: Apache-2.0
"""Which joints mirror an arm, and what is said of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simulated_calibration import active, kr5, passive, simulate

from calib_model.descriptions import parse_arm, read_description
from calib_solver.faults.mirror import mirroring_joints
from calib_solver.identification import identify

CONFIG = Path(__file__).resolve().parents[3] / 'calib_bringup/config/arms'
pytestmark = pytest.mark.timeout(60)


@pytest.mark.parametrize(
    ('name', 'expected'),
    [('kuka_kr5_sixx_r650', (0, 3, 5)), ('kuka_lbr_iiwa14', (0, 2, 4, 6))],
)
def test_they_are_those_in_the_plane_of_symmetry(name, expected):
    arm = read_description(CONFIG / f'{name}.yaml', parse_arm)
    assert mirroring_joints(arm) == expected


def test_an_arm_without_symmetry_has_none():
    arm = kr5()
    joints = [replace(joint, d=joint.d + 0.1 * (i == 2)) for i, joint in enumerate(arm.joints)]
    assert mirroring_joints(replace(arm, joints=tuple(joints))) == ()


def counted_otherwise(measured, joints):
    q = np.array(measured.poses.joints)
    q[:, joints] *= -1
    return replace(measured, poses=replace(measured.poses, joints=q))


def test_a_seat_cannot_tell_and_says_so():
    scene = simulate(kr5(), passive(), 77, locations=4, poses=12, noise=1e-5)
    mirrored = counted_otherwise(scene.measured, [0, 3, 5])
    right, wrong = identify(scene.measured), identify(mirrored)
    assert wrong.identified.spread == pytest.approx(right.identified.spread, rel=0.3)
    for done in (right, wrong):
        assert [text for text in done.untold if 'joint_a1, joint_a4 and joint_a6' in text]


@pytest.mark.slow
def test_styli_can_and_both_causes_are_named():
    measured = simulate(kr5(), active(), 78, locations=4, poses=12, noise=1e-5).measured
    assert identify(measured).untold == ()
    first = identify(counted_otherwise(measured, [0, 3, 5])).warnings[0]
    assert 'joints joint_a1, joint_a4 and joint_a6 counted the other way' in first
    assert 'styli' in first
