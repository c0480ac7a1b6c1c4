# SPDX-License-Identifier: Apache-2.0
"""Fig. 7: the error of every distance by both probes, and what the active one gains."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from studies import faro
from studies.running import columns, findings, study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """
Fig. 7 of the chapter: FARO Sterling, each probe by its own parameters (eq. 11) on the poses that
identified them. (a) Error of the 6 distances at each of 7 locations; (b) error with the passive
minus error with the active probe, positive where the active one is better. As in the chapter,
distances to spheres that were not measured are 0. The chapter tells of it in words alone.
"""
SPHERES = (1, 6, 10, 14)
PAIRS = tuple(combinations(SPHERES, 2))
LOCATIONS = range(1, 8)
PASSIVE, ACTIVE = '#b04a2f', '#0b62a4'


def errors(kind: str, seed: int) -> np.ndarray:
    """Distance errors (7, 6) by location and pair of spheres, mm; 0 where not measured."""
    quality = faro.identified(kind, seed).identified
    keys = quality.spheres.keys
    found = np.zeros((len(LOCATIONS), len(PAIRS)))
    for (first, second), error in zip(quality.pairs, quality.distance, strict=True):
        pair = PAIRS.index((int(keys[first, 1]), int(keys[second, 1])))
        found[keys[first, 0] - 1, pair] = error * 1e3
    return found


def reach(seed: int) -> np.ndarray:
    """How far from the shoulder (7, 6) the farther sphere of each pair is, m."""
    spheres = faro.identified('passive', seed).identified.spheres
    far = {
        (int(location), int(sphere)): float(np.linalg.norm(center))
        for (location, sphere), center in zip(spheres.keys, spheres.center, strict=True)
    }
    return np.array(
        [
            [max(far.get((location, sphere), 0.0) for sphere in pair) for pair in PAIRS]
            for location in LOCATIONS
        ]
    )


def table(seed: int) -> list[str]:
    """The lines of the study."""
    passive, active = (errors(kind, seed) for kind in faro.KINDS)
    gain = passive - active
    rows = [
        (
            f'POS{location} D{first}-{second}',
            *(f'{each[location - 1, i]:.3f}' for each in (passive, active, gain)),
        )
        for location in LOCATIONS
        for i, (first, second) in enumerate(PAIRS)
    ]
    lines = [*faro.origin(faro.KINDS, seed), '', 'results/figure_7.png draws these, mm', '']
    lines += columns(('', 'passive', 'active', 'passive - active'), rows)
    return [*lines, '', *_compared(passive, active, reach(seed))]


def _compared(passive: np.ndarray, active: np.ndarray, far: np.ndarray) -> list[str]:
    known = passive > 0
    worse = known & (active > passive)
    mean = {'passive': passive[known].mean(), 'active': active[known].mean()}
    near, beyond = far[known & ~worse].mean(), far[worse].mean() if worse.any() else np.nan
    said = [
        (
            f'on average the active probe errs less ({mean["active"]:.3f} mm against '
            f'{mean["passive"]:.3f})',
            bool(mean['active'] < mean['passive']),
        ),
        (
            f'where it errs more ({worse.sum()} of {known.sum()} distances) '
            'the arm is clearly nearer '
            f'to its frontier\n    (the farther sphere is {beyond:.2f} m from the shoulder, else '
            f'{near:.2f} m)',
            bool(beyond > 1.05 * near),
        ),
    ]
    return ["of the chapter's findings, here:", *findings(said)]


def draw(seed: int) -> Figure:
    """Both graphs."""
    from matplotlib.figure import Figure

    passive, active = (errors(kind, seed).ravel() for kind in faro.KINDS)
    order = np.arange(1, len(passive) + 1)
    figure = Figure(figsize=(10, 6), layout='constrained')
    error, gain = figure.subplots(2, 1, sharex=True)
    error.bar(order - 0.2, passive, 0.4, color=PASSIVE, label='passive')
    error.bar(order + 0.2, active, 0.4, color=ACTIVE, label='active')
    error.set_title('(a) error of the distance, mm', loc='left')
    error.legend(frameon=False)
    gain.bar(order, passive - active, 0.7, color='#5b6770')
    gain.axhline(0, color='black', linewidth=0.6)
    gain.set_title('(b) passive minus active, mm: above 0 the active probe is better', loc='left')
    marks = order[:: len(PAIRS)]
    gain.set_xticks(marks, [f'P{location}' for location in LOCATIONS], ha='left')
    gain.set_xlabel('distances 1-6, 1-10, 1-14, 6-10, 6-14, 10-14 at each location')
    for axes in (error, gain):
        axes.set_xlim(0.4, len(order) + 0.6)
        for mark in marks[1:]:
            axes.axvline(mark - 0.5, color='#dddddd', linewidth=0.8, zorder=0)
    return figure


if __name__ == '__main__':
    study('figure_7', ABOUT, 1, table, draw, 'seed')
