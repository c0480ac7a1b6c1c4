# SPDX-License-Identifier: Apache-2.0
"""Fig. 9: the standard deviation of every sphere probed, by both probes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib_model.arrays import Array
from studies import faro
from studies.figure_7 import ACTIVE, LOCATIONS, PASSIVE, SPHERES
from studies.running import columns, findings, study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """
Fig. 9 of the chapter: standard deviation in X, Y and Z of the centre of every sphere probed, FARO
Sterling, each probe by its own parameters (eq. 11) on the poses that identified them. As in the
chapter, spheres that were not measured are 0. The chapter tells of it in words alone.
"""


def deviations(kind: str, seed: int) -> Array:
    """Standard deviations (28, 3) by location and sphere, mm; 0 where not measured."""
    spheres = faro.identified(kind, seed).identified.spheres
    found = np.zeros((len(LOCATIONS) * len(SPHERES), 3))
    for (location, sphere), two_sigma in zip(spheres.keys, spheres.two_sigma, strict=True):
        found[(location - 1) * len(SPHERES) + SPHERES.index(int(sphere))] = two_sigma / 2 * 1e3
    return found


def table(seed: int) -> list[str]:
    """The lines of the study."""
    passive, active = (deviations(kind, seed) for kind in faro.KINDS)
    names = [f'POS{location} B{sphere}' for location in LOCATIONS for sphere in SPHERES]
    both = np.concatenate([passive, active], axis=1)
    rows = [
        (name, *(f'{value:.3f}' for value in row)) for name, row in zip(names, both, strict=True)
    ]
    header = ('', *(f'{kind} {coordinate}' for kind in faro.KINDS for coordinate in 'XYZ'))
    lines = [*faro.origin(faro.KINDS, seed), '', 'results/figure_9.png draws these, mm', '']
    return [*lines, *columns(header, rows), '', *_compared(passive, active)]


def _compared(passive: Array, active: Array) -> list[str]:
    known = passive[:, 0] > 0
    better = (active < passive)[known]
    counts = ', '.join(f'{count}' for count in better.sum(axis=0))
    said = [
        (
            "the active probe's standard deviation is smaller on average in X, Y and Z",
            bool((active[known].mean(axis=0) < passive[known].mean(axis=0)).all()),
        ),
        (
            f'and at every sphere measured (smaller in X, Y, Z at {counts} of {known.sum()})',
            bool(better.all()),
        ),
    ]
    return ["of the chapter's findings, here:", *findings(said)]


def draw(seed: int) -> Figure:
    """One graph for each coordinate."""
    from matplotlib.figure import Figure

    passive, active = (deviations(kind, seed) for kind in faro.KINDS)
    order = np.arange(1, len(passive) + 1)
    figure = Figure(figsize=(10, 6.4), layout='constrained')
    graphs = figure.subplots(3, 1, sharex=True, sharey=True)
    for i, axes in enumerate(graphs):
        axes.bar(order - 0.2, passive[:, i], 0.4, color=PASSIVE, label='passive')
        axes.bar(order + 0.2, active[:, i], 0.4, color=ACTIVE, label='active')
        axes.set(ylabel=f'{"XYZ"[i]}, mm', xlim=(0.4, len(order) + 0.6))
        for mark in order[len(SPHERES) :: len(SPHERES)]:
            axes.axvline(mark - 0.5, color='#dddddd', linewidth=0.8, zorder=0)
    graphs[0].legend(frameon=False, ncols=2)
    graphs[0].set_title('standard deviation of the centre of the spheres probed', loc='left')
    marks = order[:: len(SPHERES)]
    graphs[2].set_xticks(marks, [f'P{location}' for location in LOCATIONS], ha='left')
    graphs[2].set_xlabel('spheres 1, 6, 10, 14 at each location')
    return figure


if __name__ == '__main__':
    study('figure_9', ABOUT, 1, table, draw, 'seed')
