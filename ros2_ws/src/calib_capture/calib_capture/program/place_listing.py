# SPDX-License-Identifier: Apache-2.0
"""Proposed places of the gauge to look at, and to plan with."""

from __future__ import annotations

import numpy as np

from calib_capture.program.listing import table
from calib_capture.program.placing import Placed
from calib_capture.program.planner import Planner
from calib_model.arrays import Array
from calib_model.descriptions import placements_yaml

LEVEL, UPRIGHT = 10.0, 70.0  # deg


def placed_yaml(placed: Placed, planner: Planner) -> str:
    """The places as `plan` and `capture` read them."""
    arm = planner.arm
    heading = f'# for {arm.name} with {planner.probe.name} before {planner.gauge.name}\n'
    return heading + placements_yaml(placed.placements, arm.base_frame)


def placed_text(placed: Placed, planner: Planner) -> list[str]:
    """Lines: the places, what is to be expected of them, and what limits them."""
    arm, gauge = planner.arm, planner.gauge
    spheres = ', '.join(map(str, planner.spheres))
    rows = [['location', 'x', 'y', 'z', 'bar', 'probed from', 'reached', 'uncertainty']]
    ends = np.array([gauge.center(number) for number in planner.spheres])
    for number, (place, sure) in enumerate(
        zip(placed.places, placed.uncertainty, strict=True), start=1
    ):
        there = place.T_base_gauge.apply(ends)
        rows.append(
            [
                str(number),
                *(f'{value:.3f}' for value in there.mean(axis=0)),
                _inclined(there[-1] - there[0]),
                _side(place.T_base_gauge.rotation[:, 2]),
                f'{place.reached:.0%}',
                f'{sure * 1e3:.4f} mm',
            ]
        )
    lines = [
        f'{len(placed.places)} locations of {gauge.name} for {arm.name} with {planner.probe.name}, '
        f'spheres {spheres}',
        '',
        *table(rows, left=(4, 5)),
        '',
        f"x, y, z: the bar's middle in {arm.base_frame}, m; reached: of the tried hands around its "
        'spheres;',
        'uncertainty: standard, of a position in the workspace, with few poses at the locations so '
        'far',
    ]
    if len(placed.places) < placed.asked:
        lines += ['', f'only {len(placed.places)} of the {placed.asked} asked for']
    if placed.refused:
        reasons = ', '.join(f'{why} {n}' for why, n in placed.refused.most_common())
        lines += [
            '',
            f'{placed.usable} of {placed.drawn} places can be used; the others: {reasons}',
        ]
    return lines


def _inclined(way: Array) -> str:
    """How a bar stands that goes this way (3,)."""
    if np.linalg.norm(way) == 0:
        return '-'
    angle = float(np.degrees(np.arcsin(abs(way[2]) / np.linalg.norm(way))))
    return 'level' if angle < LEVEL else 'upright' if angle > UPRIGHT else f'rising {angle:.0f} deg'


def _side(outward: Array) -> str:
    """Where a sphere is probed from, by the unit vector (3,) to there."""
    if outward[2] > np.cos(np.radians(30)):
        return 'above'
    return f'{np.degrees(np.arctan2(outward[1], outward[0])):.0f} deg' + (
        ' and above' if outward[2] > np.cos(np.radians(60)) else ''
    )
