# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import numpy as np
import pytest

from calib_model.descriptions import gauge_yaml, parse_gauge, read_description
from calib_model.errors import DataError, DescriptionError
from calib_model.instruments.gauge import Expansion, Gauge, Scale


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


STEEL = Expansion(11.5e-6, 1e-6, 20.0)


def test_a_warm_gauge_is_longer_and_less_sure() -> None:
    gauge = Gauge('bar', 0.022, ((1, (0, 0, 0)), (6, (0.3, 0.4, 0))), 1e-6, 2e-6, STEEL)
    warm = gauge.at(26.0, 0.5)
    assert warm.distance(1, 6) == pytest.approx(0.5 * (1 + 6 * 11.5e-6), rel=1e-12)
    standard = np.hypot(6 * 1e-6, 0.5 * 11.5e-6)
    assert warm.scale == Scale(26.0, pytest.approx(1 + 69e-6), pytest.approx(standard))
    assert warm.proportional == pytest.approx(np.hypot(2e-6, 2 * standard))
    assert gauge.at(20.0).proportional == gauge.proportional
    for unknown in (warm, Gauge('bar', 0.022, gauge.spheres)):
        with pytest.raises(DataError, match='without `expansion'):
            unknown.at(21.0)


def test_its_expansion_comes_back_from_the_text_and_odd_ones_are_refused() -> None:
    gauge = Gauge('bar', 0.022, ((1, (0.0, 0.0, 0.0)), (6, (0.3, 0.4, 0.0))), 1e-6, 2e-6, STEEL)
    text = gauge_yaml(gauge)
    assert parse_gauge(text) == gauge
    assert parse_gauge(text.replace(', reference: 20.0', '')).expansion == STEEL
    for old, new, said in (
        ('coefficient: 1.15e-05', 'coefficient: 11.5', 'expected 1/K'),
        ('uncertainty: 1.0e-06, ref', 'uncertainty: -1.0e-06, ref', 'expected 1/K from 0'),
        ('reference: 20.0', 'reference: 293.15', 'expected deg C'),
        ('coefficient: 1.15e-05, ', '', 'coefficient'),
    ):
        assert old in text
        with pytest.raises(DescriptionError, match=said):
            parse_gauge(text.replace(old, new))
