# SPDX-License-Identifier: Apache-2.0
"""The chapter's own figures, and tables in its layout with ours beside them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest

import numpy as np

from calib_solver.quality import Quality
from studies.running import columns

#: what a table says, line by line: a label and a value
Rows = Sequence[tuple[str, str]]

#: Table 1: a_i (mm), alpha_i (deg), d_i (mm), theta_0i (deg) of joints 1 to 6, then the probe (mm)
TABLE_1_JOINTS = (
    ('0.036962', '-90.052249', '-0.000002', '-0.126434'),
    ('0.102485', '90.044751', '47.891183', '14.942165'),
    ('0.097868', '-90.020699', '645.780523', '-88.99688'),
    ('-0.133079', '90.068899', '54.240741', '-3.636896'),
    ('0.057606', '90.011014', '615.242600', '89.770488'),
    ('0.367275', '-0.522698', '0.150712', '-0.878373'),
)
TABLE_1_PROBE = ('0.367276', '139.450887', '54.657080')


def _distance(*values: str) -> Rows:
    places = ('Causing Pos.', 'Causing Dist.')
    return tuple(zip(('Max.', *places, 'Min.', *places, 'Med.'), values, strict=True))


def _two_sigma(*values: str) -> Rows:
    places = ('Causing Pos.', 'Causing Sph.', 'Causing Coord.')
    means = ('Med.',) if len(values) == 9 else ('Med. X', 'Med. Y', 'Med. Z')
    return tuple(zip(('Max.', *places, 'Min.', *places, *means), values, strict=True))


TABLE_1 = (
    _distance('0.144', 'POS2', 'D1', '0.006', 'POS1', 'D2', '0.066'),
    _two_sigma('0.249', 'POS1', 'B1', 'Z', '0.035', 'POS4', 'B6', 'Y', '0.104'),
)
TABLE_2 = {
    'passive': (
        _distance('0.128', 'TEST', 'D1-10', '0.012', 'TEST', 'D1-2', '0.068'),
        _two_sigma(
            '0.202', 'TEST', 'B14', 'Z', '0.027', 'TEST', 'B3', 'X', '0.054', '0.069', '0.141'
        ),
    ),
    'active': (
        _distance('0.083', 'TEST', 'D1-12', '0.007', 'TEST', 'D1-2', '0.024'),
        _two_sigma(
            '0.167', 'TEST', 'B13', 'Z', '0.014', 'TEST', 'B2', 'X', '0.046', '0.053', '0.112'
        ),
    ),
}
#: mm. Section 4.2: eq. 13 instead of eq. 11, distances and 2 sigma, maximum and mean
EQUATION_13 = {
    'distance error, max': ('0.144', '0.015'),
    'distance error, mean': ('0.066', '0.005'),
    '2 sigma, max': ('0.249', '1.893'),
    '2 sigma, mean': ('0.104', '1.009'),
}


def millimetres(value: float) -> str:
    """A length in m as the chapter prints it."""
    return f'{value * 1e3:.3f}'


def location_name(number: int) -> str:
    """A gauge location in the chapter's words; 8 is the one never used."""
    return 'TEST' if number == 8 else f'POS{number}'


def distance_rows(quality: Quality) -> Rows:
    """Fig. 6's first column."""
    keys, values = quality.spheres.keys, []
    for row in (int(np.argmax(quality.distance)), int(np.argmin(quality.distance))):
        first, second = quality.pairs[row]
        pair = f'D{keys[first, 1]}-{keys[second, 1]}'
        values += [millimetres(quality.distance[row]), location_name(int(keys[first, 0])), pair]
    return _distance(*values, millimetres(quality.distance.mean()))


def two_sigma_rows(quality: Quality, by_coordinate: bool = False) -> Rows:
    """Fig. 6's second column, with one mean (Table 1) or one for each coordinate (Table 2)."""
    spheres, values = quality.spheres, []
    for place in (np.argmax(spheres.two_sigma), np.argmin(spheres.two_sigma)):
        row, coordinate = np.unravel_index(int(place), spheres.two_sigma.shape)
        location, sphere = spheres.keys[row]
        values += [millimetres(spheres.two_sigma[row, coordinate]), location_name(int(location))]
        values += [f'B{sphere}', 'XYZ'[int(coordinate)]]
    means = spheres.two_sigma.mean(axis=0) if by_coordinate else [spheres.two_sigma.mean()]
    return _two_sigma(*values, *map(millimetres, means))


def beside(chapter: tuple[Rows, Rows], here: tuple[Rows, Rows]) -> list[str]:
    """Distances and 2 sigma in the chapter's layout, its values and ours."""
    titles = ('Distance error (mm)', '2 sigma by sphere (mm)')
    left, right = (
        columns(
            (title, 'chapter', 'here'),
            [(label, said, ours) for (label, said), (_, ours) in zip(theirs, own, strict=True)],
        )
        for title, theirs, own in zip(titles, chapter, here, strict=True)
    )
    return [f'{one:42}{other}' for one, other in zip_longest(left, right, fillvalue='')]
