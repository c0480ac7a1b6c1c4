# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.instruments import PRISMATIC, ActiveProbe, Arm, Coupling, Gauge, Joint
from calib_model.measurement import Measurement, ProbingSet
from calib_model.transforms import RigidTransform


@pytest.fixture(scope='session')
def config() -> Path:
    """The folder of arms, probes and gauges that come with the suite."""
    return Path(__file__).resolve().parents[2] / 'calib_bringup' / 'config'


@pytest.fixture(scope='session')
def arms(config: Path) -> list[Arm]:
    """Every arm in the configuration."""
    files = sorted((config / 'arms').glob('*.yaml'))
    return [read_description(file, parse_arm) for file in files]


@pytest.fixture(scope='session')
def kr5(config: Path) -> Arm:
    return read_description(config / 'arms' / 'kuka_kr5_sixx_r650.yaml', parse_arm)


@pytest.fixture(scope='session')
def probe(config: Path) -> ActiveProbe:
    return read_description(config / 'probes' / 'active_trihedron.yaml', parse_probe)


@pytest.fixture(scope='session')
def gauge(config: Path) -> Gauge:
    return read_description(config / 'gauges' / 'ball_bar_kr5.yaml', parse_gauge)


@pytest.fixture(scope='session')
def odd_arm() -> Arm:
    """Five joints that use everything: beta, directions, offsets, nothing at a right angle, one
    that slides and one that moves with another, and a D-H chain that begins off the base and ends
    off the flange."""
    rng = np.random.default_rng(5)
    joints = []
    for i in range(5):
        a, alpha, d, theta_0, beta = rng.uniform(-1, 1, 5)
        joints.append(Joint(f'j{i}', a, alpha, d, theta_0, beta, (1, -1, -1, 1, -1)[i]))
    joints[2] = replace(joints[2], type=PRISMATIC)
    joints[4] = replace(joints[4], coupling=Coupling('j1', -0.7))
    placed = [RigidTransform(*rng.uniform(-1, 1, (2, 3))) for _ in range(2)]
    return Arm('odd', tuple(joints), 'base_link', 'tool0', *placed)


@pytest.fixture(scope='session')
def measured(kr5: Arm, probe: ActiveProbe, gauge: Gauge) -> Measurement:
    """Forty poses with readings of every digit, made up but possible."""
    rng = np.random.default_rng(3)
    count = 40
    centers = rng.uniform(-1e-3, 1e-3, (count, 3))
    poses = ProbingSet(
        np.repeat([1, 2], count // 2),
        np.tile([1, 6, 10, 14], count // 4),
        rng.uniform(-1, 1, (count, 6)),
        probe.displacements(centers, gauge.sphere_diameter),
        1_700_000_000_000_000_000 + 10_000_019 * np.arange(count),
        rng.integers(1, 30, count),
    )
    return Measurement(kr5, probe, gauge, poses).checked()
