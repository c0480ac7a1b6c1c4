# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    read_description,
)
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.transforms import RigidTransform


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


@pytest.fixture
def graph(domain: int) -> Iterator[Graph]:
    """Nodes as processes on a graph of their own, all ended with the test."""
    graph = Graph(domain)
    yield graph
    graph.end()


class Graph:
    """Starts modules as processes on one domain."""

    def __init__(self, domain: int) -> None:
        self.domain = domain
        self.environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        }
        self._running: list[subprocess.Popen[str]] = []

    def start(self, module: str, **parameters: object) -> subprocess.Popen[str]:
        """`python -m module` with these parameters; lists as they are written in YAML."""
        given = [part for key, value in parameters.items() for part in ('-p', f'{key}:={value}')]
        process = subprocess.Popen(
            [sys.executable, '-m', module, '--ros-args', *given],
            env=self.environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self._running.append(process)
        return process

    def end(self) -> None:
        """A node that is killed haunts the graph until its lease runs out: ask it first."""
        for process in self._running:
            if process.poll() is None:
                process.terminate()
        for process in self._running:
            try:
                process.communicate(timeout=10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
