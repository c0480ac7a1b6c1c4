# SPDX-License-Identifier: Apache-2.0
"""Points of one target and station that scatter more, or less, than those of another."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_solver.problem import IntArray

#: that parts which scatter alike are said not to happens once in so many times
ONCE_IN = 1000.0
#: residuals by which a part is taken to scatter as all do, before its own say otherwise
ALIKE = 6.0


def part_factors(part: IntArray, count: int, squares: Array, freedom: Array) -> Array:
    """How many times the common variance each of `count` parts has, 1 on average of residuals.

    `part` (R,) is that of each squared residual; `squares` (R,) have one common size where parts
    scatter alike, and `freedom` (R,) is the share of each that a fit leaves, 1 at most. All ones
    where they do so as far as Bartlett's test can tell.
    """
    left: Array = np.bincount(part, freedom, count).astype(np.float64)
    seen: Array = np.bincount(part, squares, count).astype(np.float64)
    told = left > 0.5
    alike: Array = np.ones(count)
    common = seen.sum() / max(left.sum(), 1e-300)
    if told.sum() < 2 or common <= 0 or not _differ(seen[told], left[told]):
        return alike
    variance = (seen + ALIKE * common) / (left + ALIKE)
    mean = float(np.bincount(part, minlength=count) @ variance) / len(part)
    factors: Array = variance / mean
    return factors


def _differ(seen: Array, left: Array) -> bool:
    """Bartlett's test of sums of squares with so many degrees of freedom each."""
    from scipy.special import chdtrc  # loads long, and only what is written needs it

    variance = np.maximum(seen / left, 1e-300)
    common = seen.sum() / left.sum()
    size = float(left.sum() * np.log(common) - left @ np.log(variance))
    correction = 1 + ((1 / left).sum() - 1 / left.sum()) / (3 * (len(left) - 1))
    return float(chdtrc(len(left) - 1, size / correction)) < 1 / ONCE_IN
