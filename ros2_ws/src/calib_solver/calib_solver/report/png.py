# SPDX-License-Identifier: Apache-2.0
"""The report's charts as PNG, drawn with matplotlib (imported only when one is asked for)."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.files import write_whole
from calib_solver.held_out import HeldOut
from calib_solver.identified import Identification
from calib_solver.points import HeldOutPoints, PointIdentification
from calib_solver.quality import Quality
from calib_solver.report.charts import SHAPES, Chart, Series
from calib_solver.report.figures import (
    convergence_chart,
    convergence_of,
    joint_charts,
    quality_charts,
    residual_charts,
)
from calib_solver.report.points import point_clouds
from calib_solver.report.workspace import workspace_charts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {
    'before': '#8b9196',
    'after': '#0b62a4',
    'held': '#c4590a',
    'x': '#0b62a4',
    'y': '#22866a',
    'z': '#a33f87',
    'level1': '#86b6dc',
    'level2': '#5f9fd0',
    'level3': '#2a78b5',
    'level4': '#c4590a',
    'level5': '#8d1f1f',
}
MARKS = {'held': 's', 'y': 's', 'z': '^'}
INK, FAINT, RULE = '#1c2126', '#5d6771', '#dce0e4'
LEAST = 1e-4  # mm, so that a perfect value stays on a logarithmic axis
UNITS_PER_INCH = 80.0
DPI = 130
#: so many dots are drawn large
FEW = 100


def all_charts(done: Identification, held_out: HeldOut | None) -> list[Chart]:
    """Every chart of the report."""
    return [
        *quality_charts(done, held_out),
        *residual_charts(done, held_out),
        *joint_charts(done),
        *workspace_charts(done, held_out),
        convergence_chart(done),
    ]


def drawn(chart: Chart) -> Figure:
    """A chart of the report as a figure."""
    width, height = (size / UNITS_PER_INCH for size in SHAPES[chart.shape])
    figure = _figure(width, height)
    axes = figure.subplots()
    # fixed margins: to find them takes longer than to draw
    figure.subplots_adjust(
        left=0.75 / width, right=1 - 0.15 / width, top=1 - 0.3 / height, bottom=0.85 / height
    )
    for one in chart.series:
        _draw(axes, one)
    for note in chart.notes:
        axes.text(note.x, note.y, note.text, color=INK, size=9, ha='center', va='center')
    axes.set(xlabel=chart.x_label, ylabel=chart.y_label)
    _title(axes, chart.title)
    if chart.logarithmic:
        axes.set_yscale('log')
    if chart.equal:
        axes.set_aspect('equal', adjustable='datalim')
    if chart.bands:
        axes.set_xlim(chart.bands[0].begin, chart.bands[-1].end)
        axes.set_xticks([(band.begin + band.end) / 2 for band in chart.bands])
        axes.set_xticklabels([band.name.split()[0] for band in chart.bands])
        axes.tick_params(axis='x', length=0)
        axes.grid(False, axis='x')
        for band in chart.bands[1:]:
            axes.axvline(band.begin, color=RULE, linewidth=0.8, zorder=0)
    if any(one.label for one in chart.series):
        _key(figure, axes)
    return figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), facecolor='white')


def _title(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=10, loc='left', color=INK, pad=8)
    axes.xaxis.label.set(color=FAINT, size=9)
    axes.yaxis.label.set(color=FAINT, size=9)
    axes.tick_params(colors=FAINT, labelsize=8, length=3, width=0.6)
    axes.tick_params(which='minor', color=RULE, length=2)
    axes.grid(True, color=RULE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[['top', 'right']].set_visible(False)
    axes.spines[['left', 'bottom']].set(color=RULE)


def _key(figure: Figure, axes: Axes) -> None:
    """Each name once, below the plot where it hides nothing."""
    handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    legend = figure.legend(
        handles.values(),
        handles.keys(),
        loc='lower center',
        ncols=3,
        frameon=False,
        fontsize=8,
        labelcolor=FAINT,
        handletextpad=0.2,
        columnspacing=1.2,
    )
    for mark in legend.get_lines():
        mark.set(markersize=5, alpha=1.0)


def _draw(axes: Axes, one: Series) -> None:
    colour = COLOURS[one.role]
    if one.joined:
        axes.plot(one.x, one.y, color=colour, linewidth=1.4)
        return
    size = 1.6 if one.fine else 4.2
    axes.plot(
        one.x,
        one.y,
        MARKS.get(one.role, 'o'),
        color=colour,
        markersize=size,
        markeredgewidth=0,
        alpha=0.6 if one.fine else 1.0,
        label=one.label or None,
    )


def before_and_after(done: Identification) -> Figure:
    """Every pose's deviation from its sphere's mean and every distance error, before and after."""
    before, after = done.initial, done.identified
    return _side_by_side(
        Panel(
            'Each pose: distance from the mean of its sphere, mm',
            'pose, sphere by sphere',
            deviation_sizes(before),
            deviation_sizes(after),
        ),
        Panel(
            'Each distance: error against the certificate, mm',
            'pair of spheres, location by location',
            before.distance * 1e3,
            after.distance * 1e3,
        ),
    )


def points_before_and_after(done: PointIdentification) -> Figure:
    """How far every point is from its prediction, and how far turned where that was measured,
    before and after."""
    before, after = done.initial, done.identified
    panels = [
        Panel(
            'Each point: distance from its prediction, mm',
            'point, station by station',
            before.distance * 1e3,
            after.distance * 1e3,
        )
    ]
    if len(after.angle):
        panels.append(
            Panel(
                'Each orientation: turned from its prediction, mrad',
                'point, station by station',
                before.angle * 1e3,
                after.angle * 1e3,
            )
        )
    return _side_by_side(*panels)


@dataclass(frozen=True)
class Panel:
    """Sizes (N,) before and after, one dot each."""

    title: str
    below: str
    before: Array
    after: Array


def _side_by_side(*panels: Panel) -> Figure:
    """Panels with a logarithmic axis each, the first the widest."""
    figure = _figure(11, 4.2)
    figure.set_layout_engine('constrained')
    widths = (3, 2)[: len(panels)]
    drawn_on = figure.subplots(1, len(panels), width_ratios=widths, squeeze=False)[0]
    for axes, panel in zip(drawn_on, panels, strict=True):
        for sizes, role, label in (
            (panel.before, 'before', 'nominal parameters'),
            (panel.after, 'after', 'identified parameters'),
        ):
            few = len(sizes) <= FEW
            axes.plot(
                np.arange(1, len(sizes) + 1),
                np.maximum(sizes, LEAST),
                'o',
                markersize=5 if few else 2.6,
                color=COLOURS[role],
                markeredgewidth=0,
                label=label,
            )
        axes.set(yscale='log', xlabel=panel.below)
        axes.yaxis.set_major_formatter('{x:g}')
        _title(axes, panel.title)
    drawn_on[0].set_xlim(0, len(panels[0].before) + 1)
    figure.legend(
        *drawn_on[0].get_legend_handles_labels(),
        loc='outside lower center',
        ncols=2,
        frameon=False,
        fontsize=10,
        labelcolor=INK,
        markerscale=2.5,
        handletextpad=0.2,
    )
    return figure


def deviation_sizes(quality: Quality) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Each pose's distance (N,) from its sphere's mean, mm."""
    return np.linalg.norm(quality.deviation, axis=1) * 1e3


def save_figures(
    done: Identification, folder: str | Path, held_out: HeldOut | None = None
) -> list[Path]:
    """Every chart of the report, and before and after at a glance, as PNG files in `folder`.

    Raises:
        CalibrationError: the folder or a file in it cannot be written.
    """
    return _saved(folder, before_and_after(done), all_charts(done, held_out))


def save_point_figures(
    done: PointIdentification, folder: str | Path, held_out: HeldOutPoints | None = None
) -> list[Path]:
    """The same of measured points.

    Raises:
        CalibrationError: the folder or a file in it cannot be written.
    """
    charts = [*point_clouds(done, held_out), convergence_of(done.fit)]
    return _saved(folder, points_before_and_after(done), charts)


def _saved(folder: str | Path, both: Figure, charts: list[Chart]) -> list[Path]:
    folder = Path(folder)
    figures = {'before_and_after': both}
    figures |= {chart.name: drawn(chart) for chart in charts}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            drawn_file = BytesIO()
            figure.savefig(drawn_file, dpi=DPI, format='png')
            write_whole(folder / f'{name}.png', drawn_file.getvalue())
    except OSError as error:
        raise CalibrationError(f'{folder}: figures cannot be written: {error.strerror}') from error
    return [folder / f'{name}.png' for name in figures]
