# SPDX-License-Identifier: Apache-2.0
"""Where a gauge stands: its frame in the arm's base frame, location by location."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import yaml

from calib_model.errors import DescriptionError
from calib_model.files import load_mapping
from calib_model.transforms import RigidTransform


def parse_placements(text: str, source: str = 'gauge locations') -> dict[int, RigidTransform]:
    """`T_base_gauge` by location number, from YAML text.

    The text: `locations: [{number: 1, translation: [x, y, z], rotation_vector: [rx, ry, rz]}]`.

    Raises:
        DescriptionError: a key is missing or has a value of the wrong kind.
    """
    top = load_mapping(text, source, ('base_frame', 'locations'))
    placements: dict[int, RigidTransform] = {}
    for row in top.rows('locations', ('number', 'translation', 'rotation_vector')):
        number = row.number('number')
        if number != int(number) or not 1 <= number <= 65535:
            raise row.refuse('number', 'expected a whole number from 1 to 65535')
        if int(number) in placements:
            raise DescriptionError(source, row.where, f'location {int(number)} is listed twice')
        translation, turn = row.numbers('translation', 3), row.numbers('rotation_vector', 3)
        placements[int(number)] = RigidTransform(np.array(translation), np.array(turn))
    return placements


def placements_yaml(placements: Mapping[int, RigidTransform], base_frame: str = 'base_link') -> str:
    """The YAML text of `T_base_gauge` by location number; every number comes back bit for bit."""
    rows = [
        {
            'number': number,
            'translation': placements[number].translation.tolist(),
            'rotation_vector': placements[number].rotation_vector.tolist(),
        }
        for number in sorted(placements)
    ]
    top = {'base_frame': base_frame, 'locations': rows}
    text: str = yaml.safe_dump(top, sort_keys=False, default_flow_style=None, width=100)
    return text
