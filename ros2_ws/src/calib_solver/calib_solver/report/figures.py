# SPDX-License-Identifier: Apache-2.0
"""The report's charts of an identification: errors, residuals, convergence."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_solver.fitting import Fit
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.quality import Quality, lengths
from calib_solver.report.charts import Band, Chart, Series

#: more dots than this say no more and only make the page heavy
MOST_DOTS = 1500
LEAST = 1e-7  # mm: keeps a perfect value on a logarithmic axis
JOINT_BINS = 24
FEWEST_IN_BIN = 4
AXES = 'XYZ'


def thinned(count: int, most: int = MOST_DOTS) -> NDArray[np.int64]:
    """At most `most` of `count` rows, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def quality_charts(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    """Distance errors by pair, 2 sigma by sphere and coordinate, lengths of single probings."""
    charts = [_two_sigma(done, held_out), _coordinates(done, held_out)]
    return [*_distances(done, held_out), *charts, *_lengths(done, held_out)]


def residual_charts(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    """Clouds of the poses' deviations from their spheres' means."""
    return [_cloud(done, held_out, first, second) for first, second in ((0, 1), (0, 2), (1, 2))]


def pose_names(quality: Quality, order: NDArray[np.int64]) -> NDArray[np.str_]:
    """What each pose (N,), whose places in the measurement are `order`, is called."""
    keys = np.repeat(quality.spheres.keys, quality.spheres.poses, axis=0)
    return np.array(
        [
            f'pose {pose}, location {location}, B{sphere}'
            for pose, (location, sphere) in zip(order.tolist(), keys.tolist(), strict=True)
        ]
    )


def pair_names(quality: Quality) -> tuple[str, ...]:
    """What each distance (M,) is called."""
    keys = quality.spheres.keys
    return tuple(f'location {keys[a, 0]}, B{keys[a, 1]} to B{keys[b, 1]}' for a, b in quality.pairs)


def sphere_names(quality: Quality) -> tuple[str, ...]:
    """What each probed sphere (S,) is called."""
    return tuple(f'location {location}, B{sphere}' for location, sphere in quality.spheres.keys)


def _mm(values: Array) -> Array:
    return np.maximum(np.abs(values) * 1e3, LEAST)


def _bands(done: Identification, held_out: HeldOut | None, of: str) -> tuple[Band, ...]:
    """The locations along the axis, the held-out ones behind the others."""
    bands: list[Band] = []
    parts = [(done.identified, '')]
    if held_out is not None:
        parts.append((held_out.identified, ' held out'))
    for quality, suffix in parts:
        rows = quality.pairs[:, 0] if of == 'pairs' else np.arange(len(quality.spheres.keys))
        location = quality.spheres.keys[rows, 0]
        for number in dict.fromkeys(location.tolist()):
            begin = bands[-1].end if bands else 0.0
            end = begin + int((location == number).sum())
            bands.append(Band(begin, end, f'{number}{suffix}'))
    return tuple(bands)


def _series(
    done: Identification,
    held_out: HeldOut | None,
    values: dict[int, Array],
    named: Callable[[Quality], tuple[str, ...]],
) -> tuple[Series, ...]:
    """Initial, identified and held-out `values`, by the id of the quality, one after the other;
    `named` says what each is called."""
    names = named(done.identified)
    first = values[id(done.identified)]
    order: Array = np.arange(len(first), dtype=np.float64) + 0.5
    series = [
        Series(order, _mm(values[id(done.initial)]), 'before', 'initial', names=names),
        Series(order, _mm(first), 'after', 'identified', names=names),
    ]
    if held_out is not None:
        after, names = values[id(held_out.identified)], named(held_out.identified)
        order = len(first) + np.arange(len(after), dtype=np.float64) + 0.5
        before = _mm(values[id(held_out.initial)])
        series.append(Series(order, before, 'before', 'initial', names=names))
        series.append(Series(order, _mm(after), 'held', 'held out, identified', names=names))
    return tuple(series)


def _qualities(done: Identification, held_out: HeldOut | None) -> list[Quality]:
    more = [] if held_out is None else [held_out.initial, held_out.identified]
    return [done.initial, done.identified, *more]


def _distances(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    values = {id(q): q.distance for q in _qualities(done, held_out)}
    if not any(len(errors) for errors in values.values()):
        return []
    return [
        Chart(
            'distance_errors',
            'Distance errors',
            'Error of the measured distance of each pair of spheres against the certificate '
            '(eq. 7).',
            'location, each with its pairs of spheres',
            'mm',
            _series(done, held_out, values, pair_names),
            logarithmic=True,
            bands=_bands(done, held_out, 'pairs'),
        )
    ]


def _two_sigma(done: Identification, held_out: HeldOut | None) -> Chart:
    values = {id(q): q.spheres.two_sigma.max(axis=1) for q in _qualities(done, held_out)}
    return Chart(
        'two_sigma',
        '2 sigma by sphere',
        'Repeatability of each probed sphere in its worst coordinate (eq. 8).',
        'location, each with its spheres',
        'mm',
        _series(done, held_out, values, sphere_names),
        logarithmic=True,
        bands=_bands(done, held_out, 'spheres'),
    )


def _coordinates(done: Identification, held_out: HeldOut | None) -> Chart:
    parts, names = [done.identified.spheres.two_sigma], sphere_names(done.identified)
    if held_out is not None:
        parts.append(held_out.identified.spheres.two_sigma)
        names += sphere_names(held_out.identified)
    values = np.concatenate(parts) * 1e3
    order: Array = np.arange(len(values), dtype=np.float64) + 0.5
    return Chart(
        'two_sigma_coordinates',
        '2 sigma by coordinate',
        'Identified parameters; coordinates of the arm base frame. A coordinate that is always '
        'the largest says from where the arm is bent or pressed.',
        'location, each with its spheres',
        'mm',
        tuple(Series(order, values[:, i], 'xyz'[i], AXES[i], names=names) for i in range(3)),
        bands=_bands(done, held_out, 'spheres'),
    )


def _lengths(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    """Deviations of the lengths between single probings against the certified length."""
    series = []
    parts = [('after', 'identified', done.identified)]
    if held_out is not None:
        parts.insert(0, ('held', 'held out, identified', held_out.identified))
    for role, label, quality in parts:
        found = lengths(quality)
        if len(found.pair):
            shown = thinned(len(found.pair))
            nominal = quality.nominal[found.pair[shown]] * 1e3
            names = tuple(np.array(pair_names(quality))[found.pair[shown]].tolist())
            away = found.deviation[shown] * 1e3
            series.append(Series(nominal, away, role, label, fine=True, names=names))
    if not series:
        return []
    return [
        Chart(
            'lengths',
            'Lengths between single probings',
            'Measured minus certified, each between one pose on either sphere; what grows with the '
            'length is an error of the arm\u2019s size.',
            'certified length, mm',
            'mm',
            tuple(series),
        )
    ]


def _cloud(done: Identification, held_out: HeldOut | None, first: int, second: int) -> Chart:
    series = []
    named: list[tuple[str, str, Identification | HeldOut]] = []
    if held_out is not None:
        named.append(('held', 'held out', held_out))
    for role, label, of in (*named, ('after', 'identified', done)):
        quality = of.identified
        rows = thinned(len(quality.deviation))
        shown = quality.deviation[rows] * 1e3
        names = tuple(pose_names(quality, of.problem.order)[rows].tolist())
        series.append(
            Series(shown[:, first], shown[:, second], role, label, fine=True, names=names)
        )
    return Chart(
        f'residuals_{"xyz"[first]}{"xyz"[second]}',
        f'Residuals in {AXES[first]} and {AXES[second]}',
        '',
        f'{AXES[first]}, mm',
        f'{AXES[second]}, mm',
        tuple(series),
        shape='square',
        equal=True,
    )


def joint_charts(done: Identification) -> list[Chart]:
    """The size of the residuals against the angle of each joint."""
    size = np.linalg.norm(done.identified.deviation, axis=1) * 1e3
    shown = thinned(len(size))
    names = tuple(pose_names(done.identified, done.problem.order)[shown].tolist())
    return [
        Chart(
            f'joint_{i}',
            name,
            '',
            'angle, °',
            'mm',
            (
                Series(q[shown], size[shown], 'after', fine=True, names=names),
                Series(*_rms_by_angle(q, size), 'held', joined=True),
            ),
            shape='small',
        )
        for i, (name, q) in enumerate(
            zip(done.arm.joint_names, np.degrees(done.problem.joints).T, strict=True), start=1
        )
    ]


def _rms_by_angle(q: Array, size: Array) -> tuple[Array, Array]:
    """Middles (B,) of stretches along a joint, and the rms in each, NaN where few poses are."""
    count = int(np.clip(len(q) // 10, 2, JOINT_BINS))
    edges = np.linspace(q.min(), q.max() + 1e-9, count + 1)
    place = np.digitize(q, edges) - 1
    poses = np.bincount(place, minlength=count)
    squares = np.bincount(place, weights=size**2, minlength=count)
    rms = np.sqrt(squares / np.maximum(poses, 1))
    return (edges[:-1] + edges[1:]) / 2, np.where(poses >= FEWEST_IN_BIN, rms, np.nan)


def convergence_chart(done: Identification) -> Chart:
    """The objective, step by step."""
    return convergence_of(done.fit)


def convergence_of(fit: Fit) -> Chart:
    """The objective of a fit, step by step."""
    history = np.array([*fit.history, fit.quadratic.phi])
    steps = np.arange(len(history), dtype=float)
    values = np.maximum(history * 1e6, 1e-30)
    return Chart(
        'convergence',
        'Convergence',
        'The objective, step by step, from the initial parameters to the last fit.',
        'step',
        'mm²',
        (Series(steps, values, 'after', joined=True), Series(steps, values, 'after')),
        logarithmic=True,
    )
