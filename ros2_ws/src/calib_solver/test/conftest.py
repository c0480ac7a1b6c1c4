# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest
from simulated_calibration import Scene, active, kr5, passive, simulate


@pytest.fixture(scope='session')
def active_scene() -> Scene:
    """A KR 5 with the active probe, readings with noise."""
    return simulate(kr5(), active(), 1, noise=5e-5)


@pytest.fixture(scope='session')
def passive_scene() -> Scene:
    """A KR 5 with the passive probe, readings with noise."""
    return simulate(kr5(), passive(), 2, noise=5e-5)


@pytest.fixture(scope='session')
def clean_scene() -> Scene:
    """A KR 5 with the active probe, readings without noise."""
    return simulate(kr5(), active(), 3)
