# SPDX-License-Identifier: Apache-2.0
"""The settings that poses were paired with, as a bag keeps them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace

from calib_model.errors import BagError
from calib_model.pairing import SteadySettings

NOTE = 'calib_capture pairing'  # the metadata record that holds what poses were paired with


def note_of(settings: SteadySettings) -> dict[str, str]:
    """The settings as a bag keeps them; every number comes back bit for bit."""
    return {key: repr(value) for key, value in asdict(settings).items()}


def settings_of(note: Mapping[str, str]) -> SteadySettings:
    """The settings from a bag's note; what it does not say is as by default.

    Raises:
        BagError: one of them is no number.
    """
    given: dict[str, float] = {}
    for each in fields(SteadySettings):
        try:
            if each.name in note:
                number = float(note[each.name])
                given[each.name] = int(number) if each.name == 'min_readings' else number
        except ValueError as error:
            raise BagError(f'{NOTE}: {each.name} is {note[each.name]!r}, no number') from error
    return replace(SteadySettings(), **given)  # type: ignore[arg-type]
