# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from calib_model.arm import Arm
from calib_model.description import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.gauge import Gauge
from calib_model.placement import parse_placements
from calib_model.probe import Probe
from calib_model.rotation import RigidTransform


@pytest.fixture(scope='session')
def config() -> Path:
    """The folder of arms, probes, gauges and their locations."""
    return Path(__file__).resolve().parents[2] / 'calib_bringup' / 'config'


@pytest.fixture(scope='session')
def kr5(config: Path) -> Arm:
    return read_description(config / 'arms' / 'kuka_kr5_sixx_r650.yaml', parse_arm)


@pytest.fixture(scope='session')
def iiwa14(config: Path) -> Arm:
    return read_description(config / 'arms' / 'kuka_lbr_iiwa14.yaml', parse_arm)


@pytest.fixture(scope='session')
def probe(config: Path) -> Probe:
    return read_description(config / 'probes' / 'active_trihedron.yaml', parse_probe)


@pytest.fixture(scope='session')
def gauge(config: Path) -> Gauge:
    return read_description(config / 'gauges' / 'ball_bar_kr5.yaml', parse_gauge)


@pytest.fixture(scope='session')
def placements(config: Path) -> dict[int, RigidTransform]:
    path = config / 'locations' / 'kr5.yaml'
    return parse_placements(path.read_text(encoding='utf-8'), str(path))
