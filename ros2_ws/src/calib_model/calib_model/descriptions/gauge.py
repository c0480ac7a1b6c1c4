# SPDX-License-Identifier: Apache-2.0
"""The description of a gauge as YAML: its certificate, in files, on topics and in results."""

from __future__ import annotations

from typing import Any

from calib_model.descriptions.text import triple, yaml_text
from calib_model.files import Fields, load_mapping
from calib_model.instruments import Expansion, Gauge

MOST_SPHERES = 1000
LARGEST_EXPANSION = 1e-3  # 1/K: forty times that of aluminium


def parse_gauge(text: str, source: str = 'gauge description') -> Gauge:
    """A gauge from its YAML text.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    top = load_mapping(
        text, source, ('name', 'sphere_diameter', 'spheres', 'uncertainty', 'expansion')
    )
    diameter = top.number('sphere_diameter')
    if not diameter > 0:
        raise top.refuse('sphere_diameter', 'expected a diameter above zero')
    spheres: list[tuple[int, tuple[float, float, float]]] = []
    rows = top.rows('spheres', ('number', 'center'))
    if len(rows) > MOST_SPHERES:
        raise top.refuse('spheres', f'expected {MOST_SPHERES} at most, got {len(rows)}')
    for row in rows:
        number = row.number('number')
        if number != int(number) or not 0 <= number <= 65535:
            raise row.refuse('number', 'expected a whole number from 0 to 65535')
        if int(number) in [known for known, _ in spheres]:
            raise row.refuse('number', f'sphere {int(number)} is listed twice')
        spheres.append((int(number), triple(row.numbers('center', 3))))
    constant, proportional = 0.0, 0.0
    if 'uncertainty' in top:
        uncertainty = top.mapping('uncertainty', ('constant', 'proportional'))
        constant = uncertainty.number('constant', 0.0)
        proportional = uncertainty.number('proportional', 0.0)
    expansion = _expansion(top) if 'expansion' in top else None
    return Gauge(top.text('name'), diameter, tuple(spheres), constant, proportional, expansion)


def _expansion(top: Fields) -> Expansion:
    row = top.mapping('expansion', ('coefficient', 'uncertainty', 'reference'))
    coefficient, uncertainty = row.number('coefficient'), row.number('uncertainty', 0.0)
    if not abs(coefficient) <= LARGEST_EXPANSION:
        span = f'-{LARGEST_EXPANSION:g} to {LARGEST_EXPANSION:g}'
        raise row.refuse('coefficient', f'expected 1/K from {span}, as in 11.5e-6 of steel')
    if not 0 <= uncertainty <= LARGEST_EXPANSION:
        raise row.refuse('uncertainty', f'expected 1/K from 0 to {LARGEST_EXPANSION:g}')
    reference = row.number('reference', 20.0)
    if not -100 <= reference <= 200:
        raise row.refuse('reference', 'expected deg C, as in 20.0')
    return Expansion(coefficient, uncertainty, reference)


def gauge_yaml(gauge: Gauge) -> str:
    """The YAML text of a gauge; every number comes back bit for bit."""
    content: dict[str, Any] = {
        'name': gauge.name,
        'sphere_diameter': gauge.sphere_diameter,
        'spheres': [{'number': n, 'center': list(center)} for n, center in gauge.spheres],
        'uncertainty': {'constant': gauge.constant, 'proportional': gauge.proportional},
    }
    if gauge.expansion is not None:
        content['expansion'] = vars(gauge.expansion)
    return yaml_text(content)
