# SPDX-License-Identifier: Apache-2.0
"""Between what numbers settings may be."""

from __future__ import annotations

#: what the settings of pairing may be: s, but for max_speed in rad/s, max_spread in m and spacing
#: in rad
PAIRING = {
    'settle': (0.0, 60.0),
    'dwell': (0.0, 60.0),
    'max_speed': (0.0, 1e3),
    'max_spread': (0.0, 1.0),
    'max_gap': (1e-6, 60.0),
    'lateness': (0.0, 60.0),
    'spacing': (0.0, 100.0),
    'seated': (0.0, 60.0),
    'min_readings': (1, 1e6),
}

#: deg C of a gauge: below the one nothing is, above the other no probe works
TEMPERATURE = -273.15, 500.0
