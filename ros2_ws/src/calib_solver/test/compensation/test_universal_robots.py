# SPDX-License-Identifier: Apache-2.0
"""The UR driver's file says what the identified arm does, frame by frame as its own files do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import yaml
from simulated_calibration import kr5, on_a_rail, passive, perturbed, simulate

from calib_model.bags import write_measurement
from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics import forward_kinematics
from calib_model.transforms import RigidTransform
from calib_solver.commands.identify import run as run_identify
from calib_solver.commands.ur_kinematics import main
from calib_solver.compensation.calibrated_arm import read_calibrated
from calib_solver.compensation.universal_robots import KEYS, LINKS, driver_yaml

pytestmark = pytest.mark.timeout(60)
ARMS = Path(__file__).resolve().parents[3] / 'calib_bringup' / 'config' / 'arms'
UR5 = read_description(ARMS / 'ur5.yaml', parse_arm)
#: of the driver's own file for the UR5 (x, y, z, roll, pitch, yaw)
DRIVERS = (
    (0.0, 0.0, 0.089159, 0.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, np.pi / 2, 0.0, 0.0),
    (-0.425, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-0.39225, 0.0, 0.10915, 0.0, 0.0, 0.0),
    (0.0, -0.09465, 0.0, np.pi / 2, 0.0, 0.0),
    (0.0, 0.0823, 0.0, -np.pi / 2, 0.0, 0.0),
)


def as_ur_description(text: str) -> str:
    """The chain of ur_description's macro with the numbers of a kinematics file."""
    rows = yaml.safe_load(text)['kinematics']
    names = ['base_link_inertia', *LINKS]
    joints = [('base_link', names[0], 'fixed', '0 0 0', f'0 0 {np.pi!r}')]
    for parent, child in zip(names, names[1:], strict=False):
        values = [repr(rows[child][key]) for key in KEYS]
        xyz, angles = ' '.join(values[:3]), ' '.join(values[3:])
        joints.append((parent, child, 'continuous', xyz, angles))
    body = ''.join(f'<link name="{name}"/>' for name in ('base_link', *names))
    for parent, child, kind, xyz, angles in joints:
        body += (
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}" rpy="{angles}"/>'
            '<axis xyz="0 0 1"/></joint>'
        )
    return f'<robot name="ur">{body}</robot>'


def off(arm: Arm, text: str) -> float:
    """How far Pinocchio has the driver's wrist_3 from the arm's flange, any element, m."""
    model = pinocchio.buildModelFromXML(as_ur_description(text))
    data = model.createData()
    frame = model.getFrameId('wrist_3')
    q = np.random.default_rng(7).uniform(-3, 3, (30, arm.n))
    found = []
    for row in q:
        # continuous joints are held as cosine and sine
        pairs = np.stack([np.cos(row), np.sin(row)], axis=1).reshape(-1)
        pinocchio.framesForwardKinematics(model, data, pairs)
        found.append(data.oMf[frame].homogeneous)
    return float(np.abs(np.array(found) - forward_kinematics(arm, q)).max())


def errors_of_a_calibration(arm: Arm, seed: int) -> Arm:
    """The arm off in what probing shows; the last row is the probe's mount."""
    off = perturbed(arm, np.random.default_rng(seed)).geometry.copy()
    off[:, -1] = arm.geometry[:, -1]
    return arm.with_geometry(off)


def test_the_nominal_ur5_is_the_drivers_own_file() -> None:
    rows = yaml.safe_load(driver_yaml(UR5))['kinematics']
    assert list(rows) == [*LINKS, 'hash']
    for name, expected in zip(LINKS, DRIVERS, strict=True):
        np.testing.assert_allclose([rows[name][key] for key in KEYS], expected, atol=1e-12)


@pytest.mark.parametrize('seed', range(3))
def test_pinocchio_has_the_identified_flange_where_we_have_it(seed: int) -> None:
    arm = errors_of_a_calibration(UR5, seed)
    text = driver_yaml(arm)
    assert off(arm, text) < 1e-9
    assert off(UR5, text) > 1e-4
    for name, expected in zip(LINKS, DRIVERS, strict=True):
        found = [yaml.safe_load(text)['kinematics'][name][key] for key in KEYS]
        assert np.abs(np.array(found) - expected).max() < 0.02  # the meshes still fit


def test_the_controllers_own_base_frame_is_taken_as_it_is() -> None:
    turned = RigidTransform(np.zeros(3), np.array([0.0, 0.0, np.pi]))
    arm = replace(UR5, base_frame='base', base_T_dh=turned)
    one, other = (yaml.safe_load(driver_yaml(each))['kinematics'] for each in (UR5, arm))
    for name in LINKS:
        for key in KEYS:
            assert one[name][key] == pytest.approx(other[name][key], abs=1e-12)


@pytest.mark.parametrize(
    ('arm', 'problem'),
    [
        (on_a_rail(), 'expected six joints that turn, each by itself'),
        (replace(UR5, base_frame='world'), "base frame 'world': expected one of the driver's"),
        (replace(UR5, dh_T_flange=RigidTransform(np.array([0.1, 0, 0]))), 'on the last axis'),
        (replace(kr5(), base_frame='base'), 'axes 4 and 5|axes 5 and 6|on the last axis|parallel'),
    ],
)
def test_what_the_form_has_no_place_for_is_refused(arm: Arm, problem: str) -> None:
    with pytest.raises(DataError, match=problem):
        driver_yaml(arm)


def test_the_command_writes_a_results_arm(tmp_path: Path) -> None:
    bag, result, out = tmp_path / 'bag', tmp_path / 'result', tmp_path / 'ur.yaml'
    write_measurement(bag, simulate(UR5, passive(), 4, locations=2, poses=20).measured)
    run_identify([str(bag), '--output', str(result), '--quick'])
    assert main([str(result), str(out), '--hash', 'calib_42']) == 0
    text = out.read_text()
    assert off(read_calibrated(result).identified, text) < 1e-9
    assert yaml.safe_load(text)['kinematics']['hash'] == 'calib_42'
