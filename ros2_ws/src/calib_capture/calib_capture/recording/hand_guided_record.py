# SPDX-License-Identifier: Apache-2.0
"""What a hand-guided capture was paired with, as its bag keeps it, and what its clocks told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from calib_model.descriptions import parse_placements, placements_yaml
from calib_model.errors import BagError
from calib_model.pairing import (
    HAND_GUIDED_NOTE,
    ClockOffset,
    HandGuidedSettings,
    hand_guided_settings_of,
)
from calib_model.stamps import SECOND
from calib_model.transforms import RigidTransform

CLOCK_NOTE = 'calib_capture clock'
APART = SECOND  # ns between the newest stamps of both streams that are worth a word


@dataclass(frozen=True)
class HandGuidedRecord:
    """Settings, `T_base_gauge` by location, sphere numbers (empty: all), and the shift in ns."""

    settings: HandGuidedSettings
    placements: dict[int, RigidTransform]
    spheres: tuple[int, ...] = ()
    shift: int = 0

    def content(self) -> dict[str, str]:
        """As a bag keeps it; every number comes back bit for bit."""
        numbers = {key: repr(value) for key, value in asdict(self.settings).items()}
        return {
            **numbers,
            'shift': str(self.shift),
            'spheres': ' '.join(map(str, self.spheres)),
            'placements': placements_yaml(self.placements),
        }

    @staticmethod
    def read(note: Mapping[str, str], source: str) -> HandGuidedRecord | None:
        """What a bag's note says; None when there is none.

        Raises:
            BagError: it says something that is no number, or none that makes sense.
            DescriptionError: its placements cannot be used.
        """
        if not note:
            return None
        settings, shift = hand_guided_settings_of(note, source)
        try:
            spheres = tuple(int(number) for number in note['spheres'].split())
            places = note['placements']
        except (KeyError, ValueError) as error:
            raise BagError(f'{source}: {HAND_GUIDED_NOTE}: {error}') from error
        return HandGuidedRecord(settings, parse_placements(places, source), spheres, shift)


def clock_content(found: ClockOffset | None, shift: int) -> dict[str, str]:
    """What the clocks told, and by how much readings were shifted (ns), as a bag keeps it."""
    content = {'shift': str(shift)}
    if found is not None:
        content['offset'] = repr(found.seconds)
        content['standard_uncertainty'] = repr(found.standard_uncertainty)
        content['readings'] = str(found.readings)
    return content


def clock_line(found: ClockOffset | None, shift: int) -> str:
    """The same in words."""
    line = found.line() if found is not None else 'clock offset: not enough motion in contact'
    return f'{line}, corrected by {shift * 1e-6:+.3f} ms' if shift else line


def apart(joints: int, reading: int) -> str:
    """A word on newest stamps (ns) that no two clocks of one machine have; empty for others."""
    if not joints or not reading or abs(reading - joints) <= APART:
        return ''
    return (
        f'; the stamps of readings are {(reading - joints) / SECOND:+.1f} s from those of '
        'joint states: do their clocks agree?'
    )
