# SPDX-License-Identifier: Apache-2.0
"""Pictures of a calibration, drawn with matplotlib (imported only when one is asked for)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib_model.arm import Arm
from calib_model.errors import CalibrationError
from calib_model.probe import Probe
from calib_model.rotation import Array
from calib_solver.identification import Identification
from calib_solver.problem import Problem
from calib_solver.quality import Quality, probed_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BEFORE, AFTER = '#9a9a9a', '#0b62a4'
LEAST = 1e-4  # mm, so that a perfect value stays on a logarithmic axis


def before_and_after(done: Identification) -> Figure:
    """Every pose's deviation from its sphere's mean and every distance error, before and after."""
    from matplotlib.figure import Figure

    measured = done.problem.measured
    figure = Figure(figsize=(11, 4.2), layout='constrained')
    poses, distances = figure.subplots(1, 2, width_ratios=(3, 2))
    spread = {
        BEFORE: deviation_sizes(done.problem, done.initial, measured.arm, measured.probe),
        AFTER: deviation_sizes(done.problem, done.identified, done.arm, done.probe),
    }
    for (colour, size), label in zip(spread.items(), ('nominal', 'identified'), strict=True):
        poses.plot(np.maximum(size, LEAST), '.', color=colour, markersize=2.5, label=label)
    for start in done.problem.start[1:-1]:
        poses.axvline(float(start) - 0.5, color='#e4e4e4', linewidth=0.6, zorder=0)
    poses.set(yscale='log', xlim=(0, len(done.problem.joints)), xlabel='pose, sphere by sphere')
    poses.set_title('deviation from the mean of its sphere, mm')
    poses.legend(loc='lower right', markerscale=4)
    order = np.arange(len(done.initial.distance))
    errors = {BEFORE: done.initial.distance, AFTER: done.identified.distance}
    for colour, error in errors.items():
        distances.plot(order, np.maximum(error * 1e3, LEAST), 'o', color=colour, markersize=4)
    distances.set(yscale='log', xlabel='distance between two spheres, location by location')
    distances.set_title('error of the measured distance, mm')
    return figure


def deviation_sizes(problem: Problem, quality: Quality, arm: Arm, probe: Probe) -> Array:
    """Each pose's distance (N,) from its sphere's mean, mm."""
    points = probed_points(problem, arm, probe)
    centers = np.repeat(quality.spheres.center, problem.counts, axis=0)
    size: Array = np.linalg.norm(points - centers, axis=1) * 1e3
    return size


def save_figures(done: Identification, folder: str | Path) -> list[Path]:
    """The figures as PNG files in `folder`, which exists.

    Raises:
        CalibrationError: a file cannot be written.
    """
    path = Path(folder) / 'before_and_after.png'
    try:
        before_and_after(done).savefig(path, dpi=110)
    except OSError as error:
        raise CalibrationError(f'{path}: cannot be written: {error.strerror}') from error
    return [path]
