# SPDX-License-Identifier: Apache-2.0
"""What people know of a calibration and no bag does: for the first page of its report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from calib_model.bounds import TEMPERATURE
from calib_model.errors import DescriptionError
from calib_model.files import load_mapping
from calib_solver.results.limits import limits_of

KEYS = ('number', 'operator', 'organisation', 'serials', 'temperature', 'limits', 'notes')


@dataclass(frozen=True)
class Info:
    """The report's number, who measured and for whom, `serials` by instrument, the gauge's
    `temperature` (deg C), `limits` (m) by name, and notes; what is not known is empty."""

    number: str = ''
    operator: str = ''
    organisation: str = ''
    serials: Mapping[str, str] = field(default_factory=dict)
    temperature: float | None = None
    limits: Mapping[str, float] = field(default_factory=dict)
    notes: str = ''


def parse_info(text: str, source: str = 'info') -> Info:
    """What is known, from YAML text.

    Raises:
        DescriptionError: a key is unknown or has a value of the wrong kind; names it.
    """
    top = load_mapping(text, source, KEYS)
    for key in top.content:
        if key not in KEYS:
            raise DescriptionError(source, str(key), f'unknown key (known: {", ".join(KEYS)})')

    def words(key: str) -> str:
        value = top.content.get(key, '')
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            raise top.refuse(key, f'expected text, got {value!r:.40}')
        return str(value).strip()

    serials = top.content.get('serials', {})
    if not isinstance(serials, Mapping):
        raise top.refuse('serials', 'expected one by instrument, as {arm: "123", probe: "7"}')
    temperature = top.number('temperature') if 'temperature' in top else None
    if temperature is not None and not TEMPERATURE[0] <= temperature <= TEMPERATURE[1]:
        raise top.refuse('temperature', f'expected deg C, got {temperature:g}')
    return Info(
        words('number'),
        words('operator'),
        words('organisation'),
        {str(name): str(serial) for name, serial in serials.items()},
        temperature,
        limits_of(top) if 'limits' in top else {},
        words('notes'),
    )
