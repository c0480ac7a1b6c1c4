# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from calib_model.descriptions import parse_gauge, read_description
from calib_model.errors import DataError
from calib_model.instruments.gauge import Gauge


def test_distances_are_between_certified_centres() -> None:
    gauge = Gauge('bar', 0.022, ((1, (0, 0, 0)), (6, (0.3, 0.4, 0)), (9, (0.3, 0.4, 1.2))))
    assert gauge.distance(1, 6) == pytest.approx(0.5, abs=1e-15)
    assert gauge.distance(9, 1) == pytest.approx(1.3, abs=1e-15)
    assert gauge.pairs() == [(1, 6), (1, 9), (6, 9)]


def test_uncertainty_is_the_certificates() -> None:
    gauge = Gauge('bar', 0.022, ((1, (0, 0, 0)),), 1e-6, 1e-6)
    assert gauge.distance_uncertainty(0.5) == pytest.approx(1.5e-6)


def test_a_sphere_not_on_the_certificate_is_refused(gauge: Gauge) -> None:
    with pytest.raises(DataError, match='no sphere 16 on the certificate'):
        gauge.center(16)


@pytest.mark.parametrize(
    ('name', 'count', 'pitch'), [('ball_bar_kr5', 15, 0.04), ('ball_bar_1500', 15, 0.1)]
)
def test_the_bars_are_nearly_even_and_straight_but_not_quite(
    config: Path, name: str, count: int, pitch: float
) -> None:
    gauge = read_description(config / 'gauges' / f'{name}.yaml', parse_gauge)
    centers = np.array([gauge.center(number) for number in range(1, count + 1)])
    ideal = np.outer(np.arange(count) * pitch, [1, 0, 0])
    off = np.abs(centers - ideal)
    assert 1e-6 < off.max() < 5e-5
    assert (gauge.sphere_diameter, gauge.constant, gauge.proportional) == (0.022, 1e-6, 1e-6)
