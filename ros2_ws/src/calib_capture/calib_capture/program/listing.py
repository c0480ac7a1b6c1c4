# SPDX-License-Identifier: Apache-2.0
"""A measuring program, and proposed places of the gauge, to look at before anything runs."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from calib_capture.program.placing import Placed
from calib_capture.program.planner import Planner
from calib_capture.program.program import Program
from calib_model.arrays import Array
from calib_model.descriptions import placements_yaml
from calib_model.progress import in_words

FREQUENT = 3  # reasons named per sphere
LEVEL, UPRIGHT = 10.0, 70.0  # deg


def program_text(program: Program) -> list[str]:
    """Lines: poses per sphere and branch, what was refused and why, how many ways go around
    something, what is to be expected of it, and how long it takes where that is known."""
    locations = {plan.location for plan in program.spheres}
    counted = f'{_count(len(program.spheres), "sphere")} at {_count(len(locations), "location")}'
    lines = [f'{_count(len(program.poses), "pose")} of {counted}', '']
    lines += _spheres(program)
    lines += ['', 'branches: the signs of shoulder, elbow and wrist; refused:', '']
    lines += _refusals(program)
    around = sum(len(pose.way) > 1 for pose in program.poses)
    lines += ['', f'ways to poses that go around something: {around} of {len(program.poses)}']
    lines += [''] * bool(program.unreached)
    for plan in program.spheres:
        if not plan.poses:
            why = ', '.join(f'{reason} {n}' for reason, n in plan.reasons.items())
            lines.append(f'location {plan.location}: sphere {plan.sphere} is out of reach: {why}')
    if math.isfinite(program.seconds):
        lines += ['', f'expected duration of the capture: {in_words(program.seconds)}']
    if program.expected is not None:
        lines += ['', *expected_lines(program.expected.after)]
    return lines


def shortfall(program: Program, asked: int, standing: bool) -> str:
    """What to say of a program with fewer poses than were `asked` for of each sphere, of gauges
    that are `standing` everywhere at once or of one that is carried; empty where none is missing.
    """
    wanted, found = asked * len(program.spheres), len(program.poses)
    if found >= wanted:
        return ''
    why = (
        'every bar that stands is in the way of all postures and all motion, so some are out of '
        'reach; with one bar that is carried there are more'
        if standing
        else 'for the others there is no free posture or way'
    )
    return f'{found} of the {wanted} poses asked for can be gone to: {why}'


def expected_lines(uncertainty: float) -> list[str]:
    """What positions are to be expected after a calibration, m."""
    return [
        'expected standard uncertainty of a position in the workspace after calibration: '
        f'{uncertainty * 1e3:.4f} mm'
    ]


def _count(number: int, thing: str) -> str:
    return f'{number} {thing}' if number == 1 else f'{number} {thing}s'


def _spheres(program: Program) -> list[str]:
    branches = sorted({pose.branch for pose in program.poses})
    rows = [['location', 'sphere', 'poses', *branches, 'spares', 'hands', 'refused', 'mostly']]
    for plan in program.spheres:
        counts = Counter(pose.branch for pose in plan.poses)
        reasons = plan.reasons
        rows.append(
            [
                str(plan.location),
                str(plan.sphere),
                str(len(plan.poses)),
                *(str(counts[branch]) for branch in branches),
                str(len(plan.spares)),
                str(plan.orientations),
                str(sum(reasons.values())),
                ', '.join(f'{reason} {n}' for reason, n in list(reasons.items())[:FREQUENT]),
            ]
        )
    return table(rows)


def _refusals(program: Program) -> list[str]:
    counts: Counter[tuple[str, str]] = Counter()
    for plan in program.spheres:
        counts.update(plan.refused)
    branches = sorted({branch for branch, _ in counts})
    reasons = sorted(
        {reason for _, reason in counts}, key=lambda reason: (-_total(counts, reason), reason)
    )
    rows = [['reason', *branches, 'all']]
    for reason in reasons:
        each = [str(counts[branch, reason]) for branch in branches]
        rows.append([reason, *each, str(_total(counts, reason))])
    return table(rows, left=(0,))


def _total(counts: Counter[tuple[str, str]], reason: str) -> int:
    return sum(n for (_, other), n in counts.items() if other == reason)


def table(rows: Sequence[Sequence[str]], left: Sequence[int] = (-1,)) -> list[str]:
    """Columns under one another, numbers to the right, the columns `left` to the left."""
    columns = len(rows[0])
    to_left = {column % columns for column in left}
    width = [max(len(row[i]) for row in rows) for i in range(columns)]
    return [
        '  '.join(
            cell.ljust(size) if i in to_left else cell.rjust(size)
            for i, (cell, size) in enumerate(zip(row, width, strict=True))
        ).rstrip()
        for row in rows
    ]


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
