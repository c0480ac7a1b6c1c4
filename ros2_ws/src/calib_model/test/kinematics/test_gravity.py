# SPDX-License-Identifier: Apache-2.0
"""Gravity's torques, against the potential energy of the links computed here."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from finite_differences import differences

from calib_model.descriptions import parse_links, read_links
from calib_model.errors import DescriptionError
from calib_model.instruments import Arm
from calib_model.kinematics.forward import joint_frames
from calib_model.kinematics.gravity import Links, gravity_torques
from calib_model.urdf import arm_urdf

pytestmark = pytest.mark.timeout(60)


def links_of(arm: Arm, seed: int = 1) -> Links:
    rng = np.random.default_rng(seed)
    gravity = rng.normal(size=3) * 5
    return Links(rng.uniform(0.1, 5, arm.n), rng.uniform(-0.2, 0.2, (arm.n, 3)), gravity)


def energy(arm: Arm, links: Links, q: np.ndarray) -> np.ndarray:
    """The links' potential energy (1,), J, at one posture q (n,)."""
    total = 0.0
    for frame, mass, center in zip(joint_frames(arm, q), links.mass, links.center, strict=True):
        total -= mass * links.gravity @ (frame.origin[0] + frame.rotation[0] @ center)
    return np.array([total])


def test_torques_are_the_slope_of_the_potential_energy(arms: list[Arm], odd_arm: Arm) -> None:
    rng = np.random.default_rng(2)
    for arm in (*arms, odd_arm):
        links = links_of(arm)
        q = rng.uniform(-3, 3, (3, arm.n))
        found = gravity_torques(arm, links, q)
        for row, torque in zip(q, found, strict=True):
            slope = differences(lambda x, a=arm, k=links: energy(a, k, x), row)[0]
            np.testing.assert_allclose(arm.by_positions(torque), -slope, rtol=0, atol=1e-8)


def test_a_weight_at_arms_length_pulls_the_shoulder_down(arms: list[Arm]) -> None:
    arm = arms[0]
    weight = Links(np.eye(arm.n)[-1] * 2.0, np.zeros((arm.n, 3)))
    *_, flange = joint_frames(arm, np.zeros((1, arm.n)))
    torque = gravity_torques(arm, weight, np.zeros((1, arm.n)))[0]
    axis = list(joint_frames(arm, np.zeros((1, arm.n))))[1]
    lever = flange.origin[0] - axis.origin_joint[0]
    expected = axis.z_joint[0] @ np.cross(lever, [0, 0, -2.0 * 9.80665])
    assert torque[1] == pytest.approx(expected, rel=1e-12)
    assert abs(torque[0]) < 1e-12


def with_masses(arm: Arm, links: Links) -> str:
    """The arm's URDF with inertial elements; a link's frame is the joint's before a, alpha."""
    robot = ElementTree.fromstring(arm_urdf(arm, radius=0))
    for i, frame in enumerate(joint_frames(arm, np.zeros((1, arm.n)))):
        name = robot.findall('joint')[i].find('child').get('link')
        link = next(e for e in robot.findall('link') if e.get('name') == name)
        x, z = frame.x[0], frame.z_joint[0]
        own = np.stack([x, np.cross(z, x), z], axis=1)
        origin = frame.origin[0] - arm.joints[i].a * x
        center = frame.origin[0] + frame.rotation[0] @ links.center[i]
        local = own.T @ (center - origin)
        inertial = ElementTree.SubElement(link, 'inertial')
        ElementTree.SubElement(inertial, 'origin', xyz=' '.join(map(repr, map(float, local))))
        ElementTree.SubElement(inertial, 'mass', value=repr(float(links.mass[i])))
        ElementTree.SubElement(
            inertial, 'inertia', ixx='1e-3', iyy='1e-3', izz='1e-3', ixy='0', ixz='0', iyz='0'
        )
    return ElementTree.tostring(robot, encoding='unicode')


def test_a_urdf_says_what_yaml_says(arms: list[Arm], tmp_path) -> None:
    arm = arms[0]
    links = Links(links_of(arm).mass, links_of(arm).center)
    path = tmp_path / 'arm.urdf'
    path.write_text(with_masses(arm, links))
    read = read_links(path, arm)
    np.testing.assert_allclose(read.mass, links.mass, rtol=1e-12)
    np.testing.assert_allclose(read.center, links.center, rtol=0, atol=1e-12)


def test_files_that_cannot_be_used_say_why(arms: list[Arm], tmp_path) -> None:
    arm = arms[0]
    joint = arm.joint_names[1]
    cases = {
        'links: []': 'expected a list that is not empty',
        'links: [{joint: elbow, mass: 1, center: [0, 0, 0]}]': "no joint 'elbow'",
        f'links: [{{joint: {joint}, mass: -1, center: [0, 0, 0]}}]': 'not a negative number',
        f'links: [{{joint: {joint}, mass: 0, center: [0, 0, 0]}}]': 'at least one link',
        f'links: [{{joint: {joint}, mass: 1, center: [0, 0]}}]': 'expected 3 numbers',
    }
    for text, expected in cases.items():
        with pytest.raises(DescriptionError, match=expected):
            parse_links(text, 'links', arm)
    path = tmp_path / 'other.urdf'
    path.write_text('<robot name="x"><link name="base"/></robot>')
    with pytest.raises(DescriptionError, match='has no joint'):
        read_links(path, arm)
    path.write_text(arm_urdf(arm))
    with pytest.raises(DescriptionError, match='no link has a mass'):
        read_links(path, arm)
    bent = arm.with_geometry(arm.geometry + np.eye(5)[2][:, None] * 0.02)
    path.write_text(with_masses(bent, links_of(arm)))
    with pytest.raises(DescriptionError, match='mm and .* deg off'):
        read_links(path, arm)
    with pytest.raises(DescriptionError, match='cannot be read'):
        read_links(tmp_path / 'nowhere.yaml', arm)
