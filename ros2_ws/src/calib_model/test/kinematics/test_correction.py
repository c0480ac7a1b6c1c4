# SPDX-License-Identifier: Apache-2.0
"""What is corrected beyond D-H is read as it was written, and moves the arm as it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_model.descriptions import correction_yaml, parse_correction
from calib_model.errors import DataError, DescriptionError
from calib_model.instruments import PRISMATIC, Arm
from calib_model.kinematics.correction import Attitude, CorrectedArm, Correction, Shift
from calib_model.kinematics.forward import forward_kinematics, points
from calib_model.kinematics.gravity import Links, gravity_torques
from calib_model.kinematics.joint_errors import JointErrors, JointTerms

pytestmark = pytest.mark.timeout(60)


def everything(arm: Arm, seed: int = 1) -> Correction:
    """A correction with all its parts."""
    rng = np.random.default_rng(seed)
    n = arm.n
    links = Links(rng.uniform(0, 3, n) * (np.arange(n) > 0), rng.normal(size=(n, 3)))
    terms = JointTerms(2, links)
    return Correction(
        arm.joint_names,
        JointErrors(terms, 1e-4 * rng.normal(size=(5, n))),
        JointErrors(JointTerms(1), 1e-4 * rng.normal(size=(2, n))),
        Shift(1e-4 * rng.normal(size=(4, 3, n))),
        Attitude(1e-4 * rng.normal(size=(3, 3, 3))),
    )


def test_every_part_comes_back_bit_for_bit(arms: list[Arm]) -> None:
    rng = np.random.default_rng(3)
    for arm in arms:
        whole = everything(arm)
        names = whole.joint_names
        parts = [
            whole,
            Correction(names, joint_errors=whole.joint_errors),
            Correction(names, turn=whole.turn),
            Correction(names, shift=whole.shift),
            Correction(names, attitude=whole.attitude),
        ]
        q = rng.uniform(-3, 3, (4, arm.n))
        for correction in parts:
            text = correction_yaml(correction)
            read = parse_correction(text)
            assert correction_yaml(read) == text
            # a link without a mass has no centre to keep
            np.testing.assert_array_equal(read.joints(arm, q), correction.joints(arm, q))
            np.testing.assert_array_equal(read.shifts(arm, q), correction.shifts(arm, q))


def test_joints_shift_and_attitude_are_what_they_are_said_to_be(kr5: Arm) -> None:
    rng = np.random.default_rng(4)
    q, p_flange = rng.uniform(-2, 2, (5, 6)), rng.uniform(-0.2, 0.2, (5, 3))
    whole = everything(kr5)
    errors, turn = whole.joint_errors.values, whole.turn.values
    there = q + gravity_torques(kr5, whole.joint_errors.terms.links, q) * errors[4]
    for k in (1, 2):
        there += errors[2 * k - 2] * np.cos(k * q) + errors[2 * k - 1] * np.sin(k * q)
    there += turn[0] * np.cos(q) + turn[1] * np.sin(q)
    shift = np.zeros((5, 3))
    for k in (1, 2):
        shift += np.cos(k * q) @ whole.shift.values[2 * k - 2].T
        shift += np.sin(k * q) @ whole.shift.values[2 * k - 1].T
    rotation = forward_kinematics(kr5, q)[:, :3, :3].reshape(5, 9)
    shift += rotation @ whole.attitude.values.reshape(3, 9).T
    corrected = CorrectedArm(kr5, whole)
    np.testing.assert_allclose(corrected.joints(q), there, rtol=0, atol=1e-15)
    expected = points(kr5, there, p_flange) + shift
    np.testing.assert_allclose(corrected.points(q, p_flange), expected, rtol=0, atol=1e-15)
    T_base_flange = corrected.forward(q)
    by_matrix = np.einsum('nij,nj->ni', T_base_flange[:, :3, :3], p_flange)
    by_matrix += T_base_flange[:, :3, 3]
    np.testing.assert_allclose(by_matrix, expected, rtol=0, atol=1e-14)


def test_a_joint_that_slides_goes_by_its_scale_farther_than_it_tells(kr5: Arm) -> None:
    rail = replace(kr5.joints[1], type=PRISMATIC, direction=-1)
    arm = replace(kr5, joints=(kr5.joints[0], rail, *kr5.joints[2:]))
    errors = JointErrors(JointTerms(scale=True), np.full((1, 6), 2.5e-3))
    text = correction_yaml(Correction(arm.joint_names, errors))
    q = np.random.default_rng(6).uniform(-2, 2, (5, 6))
    there = q * np.where(arm.prismatic, 1 + 2.5e-3, 1.0)
    corrected = CorrectedArm(arm, parse_correction(text))
    np.testing.assert_allclose(corrected.forward(q), forward_kinematics(arm, there), atol=1e-15)


def test_without_a_correction_it_is_the_arm_itself(kr5: Arm) -> None:
    q = np.random.default_rng(5).uniform(-2, 2, (4, 6))
    bare = CorrectedArm(kr5)
    np.testing.assert_array_equal(bare.forward(q), forward_kinematics(kr5, q))
    np.testing.assert_array_equal(bare.points(q, np.ones(3)), points(kr5, q, np.ones(3)))
    np.testing.assert_array_equal(bare.joints(q), q)


def test_another_arms_correction_is_refused(arms: list[Arm], kr5: Arm) -> None:
    other = next(arm for arm in arms if arm.joint_names != kr5.joint_names)
    with pytest.raises(DataError, match='correction: is for joints'):
        CorrectedArm(kr5, everything(other))
    with pytest.raises(DataError, match='expected 6 joint positions'):
        CorrectedArm(kr5, everything(kr5)).forward(np.zeros((1, 5)))


def test_texts_that_cannot_be_used_say_where(kr5: Arm) -> None:
    text = correction_yaml(everything(kr5))
    cases = {
        'joints: [a, b]': "expected 'joint_errors' or 'repeatability'",
        'joints: 3': "list of the joints' names",
        'joints: [a]\njoint_errors: {encoder: [{order: 2, cosine: [0], sine: [0]}]}': 'expected 1',
        'joints: [a]\njoint_errors: {compliance: [0.0]}': "missing key 'load'",
        'joints: [a]\njoint_errors: {}': "expected 'encoder', 'scale' or 'compliance'",
        'joints: [a]\njoint_errors: {scale: [0, 1]}': '1 numbers',
        'joints: [a]\nrepeatability: {turn: [{order: 1, cosine: [0, 1], sine: [0]}]}': '1 numbers',
        text.replace('repeatability', 'repeatibility'): "unknown key 'repeatibility'",
        text.replace('attitude:', 'attitude: 3\n  other:'): 'expected a mapping',
    }
    for case, expected in cases.items():
        with pytest.raises(DescriptionError, match=expected):
            parse_correction(case, 'correction.yaml')
