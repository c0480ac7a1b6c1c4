# SPDX-License-Identifier: Apache-2.0
"""Numbers that users give, held to what makes sense."""

from __future__ import annotations

from calib_model.errors import ParameterError


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
