# SPDX-License-Identifier: Apache-2.0
"""The user's own URDF corrected beside the results of a calibration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from calib_model import urdf as urdf_files
from calib_model.errors import DataError
from calib_solver import compensation
from calib_solver.calibration.calibration import Calibration


def with_urdf(urdf: str, output: str, calibrated: Callable[[], Calibration]) -> Calibration:
    """A calibration, and the user's own file `urdf` with corrected joint origins in `output`.

    Raises:
        CalibrationError: the file cannot be read or corrected, or there is nowhere to write it.
    """
    if not urdf:
        return calibrated()
    if not output:
        raise DataError('a corrected URDF is written beside the results: name a folder for them')
    own = urdf_files.read_urdf(urdf)
    finished = calibrated()
    measured = finished.done.problem.measured
    path = compensation.write_corrected_urdf(output, own, measured.arm, finished.done.arm, urdf)
    return replace(finished, written=(*finished.written, path))
