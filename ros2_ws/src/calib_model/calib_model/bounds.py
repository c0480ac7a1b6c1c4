# SPDX-License-Identifier: Apache-2.0
"""Numbers that users give, held to what makes sense."""

from __future__ import annotations

from calib_model.errors import ParameterError

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


def number_within(name: str, value: object, least: float, most: float) -> float:
    """A parameter's number.

    Raises:
        ParameterError: no number, or not from `least` to `most`.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not isinstance(value, int | float) or not number or not least <= value <= most:
        raise ParameterError(
            f"parameter '{name}': expected a number from {least:g} to {most:g}, got {value!r}"
        )
    return float(value)
