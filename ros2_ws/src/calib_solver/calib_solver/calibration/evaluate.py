# SPDX-License-Identifier: Apache-2.0
"""The quality of given parameters on a bag: what `evaluate` prints and `/evaluate` answers."""

from __future__ import annotations

from calib_model.descriptions import parse_correction, read_description
from calib_model.progress import Progress
from calib_solver.calibration.duplicate_poses import duplicate_lines
from calib_solver.calibration.points import point_evaluation_record
from calib_solver.calibration.sources import Sources, hold_points, load_all
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.results import Record, quality_record, sphere_records


def evaluation_record(
    sources: Sources, correction: str = '', progress: Progress | None = None
) -> Record:
    """Q of the contract at the top level, and the probed spheres; `correction` is a file's path.

    `progress` hears how far reading is, and what was made of bags without poses.

    Raises:
        CalibrationError: a bag or a description cannot be used.
    """
    if hold_points(sources):
        return point_evaluation_record(sources, correction, progress)
    beyond = read_description(correction, parse_correction) if correction else None
    loaded = load_all(sources, progress)
    loaded = loaded.told_with(loaded.measured.arm, loaded.measured.probe, beyond)
    measured = loaded.measured
    if progress is not None:
        for line in (*duplicate_lines(loaded.duplicates), *loaded.lines):
            progress.say(line)
    quality = assess(Problem.of(measured), measured.arm, measured.probe, beyond)
    return {**quality_record(quality), 'spheres': sphere_records(quality.spheres)}
