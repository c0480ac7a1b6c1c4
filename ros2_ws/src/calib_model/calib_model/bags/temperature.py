# SPDX-License-Identifier: Apache-2.0
"""How warm the gauge was: a note in the bag, `gauge temperature`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from calib_model.bags.reader import read_note
from calib_model.bounds import TEMPERATURE
from calib_model.errors import BagError

TEMPERATURE_NOTE = 'gauge temperature'


@dataclass(frozen=True)
class Temperature:
    """A temperature (deg C) and its standard `uncertainty` (K)."""

    celsius: float
    uncertainty: float = 0.0

    @property
    def plausible(self) -> bool:
        """Whether there are gauges like that."""
        lowest, highest = TEMPERATURE
        return lowest <= self.celsius <= highest and 0 <= self.uncertainty <= highest

    def content(self) -> dict[str, str]:
        """The note that says so."""
        return {'celsius': repr(self.celsius), 'uncertainty': repr(self.uncertainty)}


def read_temperature(path: str | Path) -> Temperature | None:
    """The temperature that a bag's note tells, None without one.

    Raises:
        BagError: there is no bag, or its note is none.
    """
    note = read_note(path, TEMPERATURE_NOTE)
    if not note:
        return None
    try:
        found = Temperature(float(note['celsius']), float(note.get('uncertainty', 0.0)))
    except (KeyError, ValueError) as error:
        raise BagError(f'{path}: {TEMPERATURE_NOTE}: expected celsius and uncertainty') from error
    if not found.plausible:
        raise BagError(f'{path}: {TEMPERATURE_NOTE}: {note["celsius"]} deg C is none')
    return found


def together(found: list[Temperature]) -> Temperature:
    """One for all of several, sure to what they differ by."""
    celsius = math.fsum(one.celsius for one in found) / len(found)
    square = math.fsum(one.uncertainty**2 + (one.celsius - celsius) ** 2 for one in found)
    return Temperature(celsius, math.sqrt(square / len(found)))
