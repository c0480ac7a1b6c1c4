# SPDX-License-Identifier: Apache-2.0
"""Where a gauge stands: its frame in the arm's base frame, location by location."""

from __future__ import annotations

import numpy as np

from calib_model.errors import DescriptionError
from calib_model.fields import load_mapping
from calib_model.rotation import RigidTransform


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
