# SPDX-License-Identifier: Apache-2.0
"""Charts of the workspace: where the gauge stood, and how sure the arm is of its points there."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.quality import Quality
from calib_solver.report.charts import Chart, Note, Series

LEVELS = 5


def workspace_charts(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    """The gauge from above and from the side, and the uncertainty of a position over the reach."""
    size = done.position_uncertainty * 1e6
    views = ((0, 1, 'from above'), (0, 2, 'from the side'))
    return [
        *(_view(done, held_out, *view) for view in views),
        _map(done.workspace.points, size),
        _distribution(size),
    ]


def _view(
    done: Identification, held_out: HeldOut | None, first: int, second: int, view: str
) -> Chart:
    """Spheres of each location joined by a line, with the location's number at its first end."""
    series = [Series(np.zeros(1), np.zeros(1), 'before', 'arm base')]
    notes = []
    parts: list[tuple[Quality, str, str]] = [(done.identified, 'after', 'identified from')]
    if held_out is not None:
        parts.append((held_out.identified, 'held', 'held out'))
    size = max(float(np.ptp(quality.spheres.center, axis=0).max()) for quality, *_ in parts)
    for quality, role, label in parts:
        keys, center = quality.spheres.keys, quality.spheres.center
        for number in dict.fromkeys(keys[:, 0].tolist()):
            own = center[keys[:, 0] == number]
            x, y = own[:, first], own[:, second]
            series += [Series(x, y, role, joined=True), Series(x, y, role, label)]
            notes.append(_number(number, np.stack([x, y], axis=1), size))
    return Chart(
        f'workspace_{"xyz"[first]}{"xyz"[second]}',
        f'Where the gauge stood, {view}',
        'Probed spheres, joined location by location; the arm is sure of what is among them.',
        f'{"XYZ"[first]}, m',
        f'{"XYZ"[second]}, m',
        tuple(series),
        shape='view',
        equal=True,
        notes=tuple(notes),
    )


def _number(number: int, points: Array, size: float) -> Note:
    """A location's number beyond the first (K, 2) of its spheres, away from the last."""
    along = points[0] - points[-1]
    length = float(np.linalg.norm(along))
    away = along / length if length > 0.02 * size else np.array([0.0, 1.0])
    x, y = points[0] + 0.045 * size * away
    return Note(float(x), float(y), str(number))


def _map(points: Array, size: Array) -> Chart:
    """Postures drawn over the joints' ranges, in classes of equally many by `size` (K,), um."""
    radius = np.hypot(points[:, 0], points[:, 1])
    ends = np.quantile(size, np.linspace(0, 1, LEVELS + 1))
    level = np.clip(np.searchsorted(ends, size, side='right') - 1, 0, LEVELS - 1)
    series = tuple(
        Series(
            radius[level == k],
            points[level == k, 2],
            f'level{k + 1}',
            f'{ends[k]:.3g} to {ends[k + 1]:.3g} µm',
        )
        for k in range(LEVELS)
    )
    return Chart(
        'uncertainty_map',
        'Expected uncertainty over the workspace',
        'Standard uncertainty of the probed point at postures drawn between the joint limits, '
        'by its distance from the axis of joint 1 and its height.',
        'distance from axis 1, m',
        'Z, m',
        series,
        shape='view',
        equal=True,
    )


def _distribution(size: Array) -> Chart:
    size = np.sort(size)
    share = 100 * np.arange(1, len(size) + 1) / len(size)
    return Chart(
        'uncertainty_share',
        'Share of the workspace by uncertainty',
        'How much of the postures drawn has at most that standard uncertainty of a position.',
        'µm',
        '% of postures',
        (
            Series(
                np.concatenate([size[:1], size]),
                np.concatenate([[0.0], share]),
                'after',
                joined=True,
            ),
        ),
        shape='view',
    )
