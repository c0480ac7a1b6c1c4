# SPDX-License-Identifier: Apache-2.0
"""The report's charts, from an identification."""

from __future__ import annotations

import numpy as np

from calib_model.rotation import Array
from calib_solver.charts import Series, chart
from calib_solver.identification import Identification
from calib_solver.quality import Quality
from calib_solver.workspace import over_workspace

#: more dots than this say no more and only make the page heavy
MOST_DOTS = 3000
LEAST = 1e-7  # mm: keeps a perfect value on a logarithmic axis


def all_figures(done: Identification, test: Quality | None) -> list[str]:
    """Every chart that has something to show."""
    deviation = done.identified.deviation * 1e3
    figures = [*_distances(done, test), _two_sigma(done), *_clouds(deviation), _convergence(done)]
    figures += [*_workspace(done), _uncertainty(done)]
    return figures + _against_joints(done, deviation)


def _mm(values: Array) -> Array:
    return np.maximum(np.abs(values) * 1e3, LEAST)


def _thinned(count: int) -> np.ndarray:
    return np.unique(np.linspace(0, count - 1, min(count, MOST_DOTS)).astype(int))


def _distances(done: Identification, test: Quality | None) -> list[str]:
    if len(done.identified.distance) == 0:
        return []
    order = np.arange(1, len(done.identified.distance) + 1, dtype=float)
    series = [
        Series(order, _mm(done.initial.distance), 'before', 'initial'),
        Series(order, _mm(done.identified.distance), 'after', 'identified'),
    ]
    if test is not None and len(test.distance):
        held = order[-1] + 1 + np.arange(len(test.distance), dtype=float)
        series.append(Series(held, _mm(test.distance), 'held', 'held-out'))
    title = 'Distance error of each pair of spheres'
    return [chart(series, title, 'pair, location by location', 'mm', True)]


def _two_sigma(done: Identification) -> str:
    order = np.arange(1, len(done.problem.keys) + 1, dtype=float)
    series = [
        Series(order, _mm(quality.spheres.two_sigma.max(axis=1)), style, label)
        for quality, style, label in (
            (done.initial, 'before', 'initial'),
            (done.identified, 'after', 'identified'),
        )
    ]
    title = '2 sigma of each sphere, its worst coordinate'
    return chart(series, title, 'sphere, location by location', 'mm', True)


def _clouds(deviation: Array) -> list[str]:
    shown = deviation[_thinned(len(deviation))]
    return [
        chart(
            [Series(shown[:, first], shown[:, second], 'after')],
            f"Deviations from the spheres' means, {'XYZ'[first]} and {'XYZ'[second]}",
            f'{"XYZ"[first]}, mm',
            f'{"XYZ"[second]}, mm',
        )
        for first, second in ((0, 1), (0, 2))
    ]


def _convergence(done: Identification) -> str:
    history = np.array([done.fit.phi_initial, *done.fit.history[1:], done.fit.quadratic.phi])
    steps = np.arange(len(history), dtype=float)
    series = [Series(steps, np.maximum(history * 1e6, 1e-30), 'after', joined=True)]
    return chart(series, 'The objective on its way down', 'step', 'mm²', True)


def _workspace(done: Identification) -> list[str]:
    center = done.identified.spheres.center
    return [
        chart(
            [Series(center[:, first], center[:, second], 'after')],
            f'Where the spheres were, {view}',
            f'{"XYZ"[first]}, m',
            f'{"XYZ"[second]}, m',
        )
        for first, second, view in ((0, 1, 'from above'), (0, 2, 'from the side'))
    ]


def _uncertainty(done: Identification) -> str:
    sure = np.sort(over_workspace(done).position) * 1e3
    share = 100 * np.arange(1, len(sure) + 1) / len(sure)
    series = [Series(np.maximum(sure, 0.0), share, 'after', joined=True)]
    title = 'Standard uncertainty of a position over the workspace'
    return chart(series, title, 'mm', '% of postures below')


def _against_joints(done: Identification, deviation: Array) -> list[str]:
    size = np.linalg.norm(deviation, axis=1)
    shown = _thinned(len(size))
    return [
        chart(
            [Series(np.degrees(q[shown]), size[shown], 'after')],
            f'Deviation against {name}',
            '°',
            'mm',
        )
        for name, q in zip(done.arm.joint_names, done.problem.joints.T, strict=True)
    ]
