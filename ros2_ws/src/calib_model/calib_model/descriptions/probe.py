# SPDX-License-Identifier: Apache-2.0
"""The description of a probe as YAML: the same text in files, on topics and in results."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib_model.descriptions.text import transform_of, transform_row, triple, yaml_text
from calib_model.files import Fields, load_mapping
from calib_model.instruments import STYLI, ActiveProbe, PassiveProbe, Probe, Stylus


def parse_probe(text: str, source: str = 'probe description') -> Probe:
    """A probe from its YAML text.

    Raises:
        DescriptionError: a key is missing, unknown, or has a value of the wrong kind.
    """
    top = load_mapping(
        text, source, ('name', 'kind', 'flange_T_probe', 'styli', 'center', 'simulated')
    )
    name, kind = top.text('name'), top.text('kind')
    flange_T_probe = transform_of(top, 'flange_T_probe')
    simulated = top.content.get('simulated', False)
    if not isinstance(simulated, bool):
        raise top.refuse('simulated', f'expected true or false, got {simulated!r:.40}')
    if kind == 'passive':
        center = top.numbers('center', 3, (0.0, 0.0, 0.0))
        return PassiveProbe(name, flange_T_probe, np.array(center), simulated)
    if kind != 'active':
        raise top.refuse('kind', f"expected 'active' or 'passive', got {kind[:40]!r}")
    rows = top.rows('styli', ('origin', 'direction', 'tip_radius', 'stroke'))
    if len(rows) != STYLI:
        raise top.refuse('styli', f'expected {STYLI} styli, got {len(rows)}')
    first, second, third = (_stylus(row) for row in rows)
    return ActiveProbe(name, flange_T_probe, (first, second, third), simulated)


def _stylus(row: Fields) -> Stylus:
    origin, direction = row.numbers('origin', 3), row.numbers('direction', 3)
    if not 1e-9 < max(map(abs, direction)) < 1e9:
        raise row.refuse('direction', 'expected a vector that is not zero, nor huge')
    lower, upper = row.numbers('stroke', 2)
    if not lower < upper:
        raise row.refuse('stroke', 'expected [free, blocked] with free < blocked')
    tip_radius = row.number('tip_radius')
    if tip_radius < 0:
        raise row.refuse('tip_radius', 'expected a radius, not a negative number')
    return Stylus(triple(origin), triple(direction), tip_radius, (lower, upper))


def probe_yaml(probe: Probe) -> str:
    """The YAML text of a probe; every number comes back bit for bit."""
    top: dict[str, Any] = {'name': probe.name, 'kind': probe.kind}
    top['flange_T_probe'] = transform_row(probe.flange_T_probe)
    if isinstance(probe, PassiveProbe):
        top['center'] = probe.center.tolist()
    else:
        top['styli'] = [
            {
                'origin': list(s.origin),
                'direction': list(s.direction),
                'tip_radius': s.tip_radius,
                'stroke': list(s.stroke),
            }
            for s in probe.styli
        ]
    if probe.simulated:
        top['simulated'] = True
    return yaml_text(top)
