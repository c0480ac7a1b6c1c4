# SPDX-License-Identifier: Apache-2.0
"""Where the sphere is by single readings, of which any may be one that no sphere gives."""

from __future__ import annotations

import numpy as np

from calib_model.errors import ContactError
from calib_model.probe import Probe
from calib_model.rotation import Array


def known_centers(probe: Probe, displacement: Array, sphere_diameter: float) -> Array:
    """`p_probe_sphere` (N, 3), m, of readings (N, 3), m; NaN in the rows that no sphere gives."""
    try:
        return probe.centers(displacement, sphere_diameter)
    except ContactError:
        if len(displacement) == 1:
            return np.full((1, 3), np.nan)
    half = len(displacement) // 2
    parts = (displacement[:half], displacement[half:])
    return np.concatenate([known_centers(probe, part, sphere_diameter) for part in parts])
