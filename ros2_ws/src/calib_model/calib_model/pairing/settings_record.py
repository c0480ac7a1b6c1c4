# SPDX-License-Identifier: Apache-2.0
"""The settings that poses were paired with, as a bag keeps them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, fields, replace

from calib_model.bounds import PAIRING
from calib_model.errors import BagError
from calib_model.pairing.paired_readings import HandGuidedSettings
from calib_model.pairing.stop_and_go import SteadySettings
from calib_model.stamps import SECOND

NOTE = 'calib_capture pairing'  # the metadata record that holds what poses were paired with
HAND_GUIDED_NOTE = 'calib_capture led'  # the same of a hand-guided arm
MOST_SHIFT = 3600 * SECOND  # ns


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


def hand_guided_settings_of(note: Mapping[str, str], source: str) -> tuple[HandGuidedSettings, int]:
    """The settings that a hand-guided arm was paired with, and by how much its readings' stamps
    were shifted, ns.

    Raises:
        BagError: one of them is missing, is no number, or none that makes sense.
    """
    try:
        given = {
            each.name: noted_number(note, each.name, f'{source}: {HAND_GUIDED_NOTE}')
            for each in fields(HandGuidedSettings)
        }
        shift = int(note['shift'])
    except (KeyError, ValueError) as error:
        raise BagError(f'{source}: {HAND_GUIDED_NOTE}: {error}') from error
    if not abs(shift) <= MOST_SHIFT:
        raise BagError(f'{source}: {HAND_GUIDED_NOTE}: a shift of {shift} ns')
    return HandGuidedSettings(**given), shift


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
