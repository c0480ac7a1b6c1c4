# SPDX-License-Identifier: Apache-2.0
"""How long an arm takes from posture to posture."""

from __future__ import annotations

import numpy as np

from calib_model.rotation import Array


def travel_time(start: Array, goals: Array, velocity: Array) -> Array:
    """Seconds (K,) from posture `start` (n,) to `goals` (K, n) at the joints' speeds (n,)."""
    finite = np.where(np.isfinite(velocity), velocity, 1.0)
    seconds: Array = np.max(np.abs(goals - start) / finite, axis=1)
    return seconds
