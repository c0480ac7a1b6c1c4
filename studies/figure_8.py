# SPDX-License-Identifier: Apache-2.0
"""Fig. 8: how far every single point is from the mean of its sphere, by both probes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib_model.arrays import Array
from calib_solver.quality import probed_points
from studies import faro
from studies.running import columns, findings, study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """
Fig. 8 of the chapter: point repeatability errors (eq. 12) in X, Y and Z of about 10,000 points by
each probe, FARO Sterling, each probe by its own parameters (eq. 11) on the poses that identified
them. (a) Active probe, (b) passive probe. The chapter tells of it in words alone.
"""
COLOURS = ('#b04a2f', '#3c8d53', '#0b62a4')


def deviations(kind: str, seed: int) -> Array:
    """Eq. 12 for every pose (N, 3), mm: mean of its sphere minus the point."""
    done = faro.identified(kind, seed)
    means = np.repeat(done.identified.spheres.center, done.problem.counts, axis=0)
    deviation: Array = means - probed_points(done.problem, done.arm, done.probe)
    return deviation * 1e3


def table(seed: int) -> list[str]:
    """The lines of the study."""
    found = {kind: deviations(kind, seed) for kind in reversed(faro.KINDS)}
    rows = []
    for letter, (kind, error) in zip('ab', found.items(), strict=True):
        for coordinate, values in zip('XYZ', error.T, strict=True):
            size = np.abs(values)
            rows.append(
                (
                    f'({letter}) {kind}, {coordinate}',
                    str(len(values)),
                    f'{np.sqrt(np.mean(values**2)):.3f}',
                    f'{np.quantile(size, 0.95):.3f}',
                    f'{size.max():.3f}',
                )
            )
    header = ('', 'points', 'rms', '95 % below', 'largest')
    lines = [*faro.origin(faro.KINDS, seed), '', 'results/figure_8.png draws them all, mm', '']
    return [*lines, *columns(header, rows), '', *_compared(found['passive'], found['active'])]


def _compared(passive: Array, active: Array) -> list[str]:
    of_passive, of_active = (np.sqrt((error**2).mean(axis=0)) for error in (passive, active))
    ratio = of_passive / of_active
    shown = ', '.join(f'{value:.2f}' for value in ratio)
    said = [
        ("the active probe's errors are smaller in every coordinate", bool((ratio > 1).all())),
        ('the passive probe errs most in Z', int(of_passive.argmax()) == 2),
        ('the active probe errs most in Z, too', int(of_active.argmax()) == 2),
        (
            f'what the active one gains is most in Z (passive over active, X, Y, Z: {shown})',
            int(ratio.argmax()) == 2,
        ),
    ]
    return [
        "of the chapter's findings, here:",
        *findings(said),
        '',
        "The chapter's reason is built into our world: pushes from all sides compensate one",
        'another level, but every push has weight in it and goes down.',
    ]


def draw(seed: int) -> Figure:
    """Both graphs, one colour for each coordinate."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 6.4), layout='constrained')
    graphs = figure.subplots(2, 1, sharey=True)
    for axes, letter, kind in zip(graphs, 'ab', reversed(faro.KINDS), strict=True):
        error = deviations(kind, seed)
        for i in (2, 1, 0):  # the widest first, so that it hides no other
            axes.plot(error[:, i], ',', color=COLOURS[i])
        for coordinate, colour in zip('XYZ', COLOURS, strict=True):
            axes.plot([], [], 's', color=colour, label=coordinate)
        axes.set(xlim=(0, len(error)), ylabel='mm')
        axes.set_title(f'({letter}) {kind} probe', loc='left')
        axes.legend(frameon=False, loc='upper right', ncols=3)
    graphs[1].set_xlabel('point, sphere by sphere, location by location')
    return figure


if __name__ == '__main__':
    study('figure_8', ABOUT, 1, table, draw, 'seed')
