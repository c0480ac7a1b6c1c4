# SPDX-License-Identifier: Apache-2.0
"""A measuring program to look at before it runs, as text."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from calib_capture.program.program import Program
from calib_model.progress import in_words

FREQUENT = 3  # reasons named per sphere


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
