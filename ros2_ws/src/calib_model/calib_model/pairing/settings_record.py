# SPDX-License-Identifier: Apache-2.0
"""The settings that poses were paired with, as a bag keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace

from calib_model.errors import BagError
from calib_model.pairing.stop_and_go import SteadySettings

NOTE = 'calib_capture pairing'  # the metadata record that holds what poses were paired with


def note_of(settings: SteadySettings) -> dict[str, str]:
    """The settings as a bag keeps them; every number comes back bit for bit."""
    return {key: repr(value) for key, value in asdict(settings).items()}


def settings_of(note: Mapping[str, str]) -> SteadySettings:
    """The settings from a bag's note; what it does not say is as by default.

    Raises:
        BagError: one of them is no number, or none that makes sense.
    """
    given: dict[str, float] = {}
    for each in fields(SteadySettings):
        if each.name in note:
            number = noted_number(note, each.name, NOTE)
            given[each.name] = int(number) if each.name == 'min_readings' else number
    return replace(SteadySettings(), **given)  # type: ignore[arg-type]


def noted_number(note: Mapping[str, str], name: str, source: str) -> float:
    """A setting of pairing as a bag's note has it.

    Raises:
        BagError: it is no number, or none that makes sense.
    """
    least, most = PAIRING[name]
    try:
        number = float(note[name])
    except ValueError:
        number = math.nan
    if not least <= number <= most:
        raise BagError(
            f'{source}: {name} is {note[name]!r}, expected a number from {least:g} to {most:g}'
        )
    return number


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
