# SPDX-License-Identifier: Apache-2.0
"""The report's charts as PNG, drawn with matplotlib (imported only when one is asked for)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib_model.errors import CalibrationError
from calib_model.files import write_whole
from calib_solver.held_out import HeldOut
from calib_solver.identification import Identification
from calib_solver.quality import Quality
from calib_solver.report.charts import SHAPES, Chart, Series
from calib_solver.report.figures import (
    convergence_chart,
    joint_charts,
    quality_charts,
    residual_charts,
)
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
    figure = _figure(11, 4.2)
    figure.set_layout_engine('constrained')
    poses, distances = figure.subplots(1, 2, width_ratios=(3, 2))
    for quality, role, label in (
        (done.initial, 'before', 'nominal parameters'),
        (done.identified, 'after', 'identified parameters'),
    ):
        size = np.maximum(deviation_sizes(quality), LEAST)
        style = {'color': COLOURS[role], 'markeredgewidth': 0, 'label': label}
        poses.plot(np.arange(len(size)), size, 'o', markersize=2.6, **style)
        error = np.maximum(quality.distance * 1e3, LEAST)
        distances.plot(np.arange(1, len(error) + 1), error, 'o', markersize=5, **style)
    for axes, title, below in (
        (poses, 'Each pose: distance from the mean of its sphere, mm', 'pose, sphere by sphere'),
        (
            distances,
            'Each distance: error against the certificate, mm',
            'pair of spheres, location by location',
        ),
    ):
        axes.set(yscale='log', xlabel=below)
        axes.yaxis.set_major_formatter('{x:g}')
        _title(axes, title)
    poses.set_xlim(0, len(done.problem.joints))
    figure.legend(
        *poses.get_legend_handles_labels(),
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
    folder = Path(folder)
    figures = {'before_and_after': before_and_after(done)}
    figures |= {chart.name: drawn(chart) for chart in all_charts(done, held_out)}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            drawn_file = BytesIO()
            figure.savefig(drawn_file, dpi=DPI, format='png')
            write_whole(folder / f'{name}.png', drawn_file.getvalue())
    except OSError as error:
        raise CalibrationError(f'{folder}: figures cannot be written: {error.strerror}') from error
    return [folder / f'{name}.png' for name in figures]
