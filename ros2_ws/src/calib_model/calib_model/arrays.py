# SPDX-License-Identifier: Apache-2.0
"""The array type that crosses rooms, and arrays that are read-only once built."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frozen(values: object) -> Array:
    """A read-only float64 copy of `values`, any shape."""
    array = np.array(values, dtype=np.float64, order='C')
    array.setflags(write=False)
    return array
