# SPDX-License-Identifier: Apache-2.0
"""Limits of an acceptance test, from a file, and how a quality stands to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calib_model.errors import DataError, DescriptionError
from calib_model.files import Fields, load_mapping
from calib_solver.results.quality import Record

#: where a quality record has what each limit is set for
LIMITED: dict[str, tuple[str, ...]] = {
    'distance_max': ('distance', 'max'),
    'distance_mean': ('distance', 'mean'),
    'distance_rms': ('distance', 'rms'),
    'two_sigma_max': ('two_sigma', 'max'),
    'two_sigma_mean': ('two_sigma', 'mean'),
    'position_max': ('position', 'max'),
    'position_mean': ('position', 'mean'),
    'position_rms': ('position', 'rms'),
    'single_point_max': ('measuring_arm', 'single_point', 'max_deviation'),
    'single_point_two_s_max': ('measuring_arm', 'single_point', 'two_s_max'),
    'length_max': ('measuring_arm', 'length', 'max_deviation'),
    'length_two_rms': ('measuring_arm', 'length', 'two_rms'),
    'location_error': ('standards', 'location_error'),
    'length_error': ('standards', 'length_error'),
    'pose_accuracy': ('standards', 'pose_accuracy'),
    'pose_repeatability': ('standards', 'pose_repeatability'),
    'distance_accuracy': ('standards', 'distance_accuracy'),
    'distance_repeatability': ('standards', 'distance_repeatability'),
}
#: m: who asks for more of a calibrated arm has taken millimetres for metres
FARTHEST = 0.1


@dataclass(frozen=True)
class Judged:
    """A limit (m), the value (m) that stands against it, and whether it is kept."""

    name: str
    limit: float
    value: float

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        return self.value <= self.limit

    def record(self) -> Record:
        """As JSON has it."""
        return {'limit': self.name, 'allowed': self.limit, 'value': self.value} | {
            'passed': self.passed
        }


def parse_limits(text: str, source: str = 'limits') -> dict[str, float]:
    """Limits (m) by name from YAML text: `limits: {distance_max: 0.0001, ...}`.

    Raises:
        DescriptionError: there are none, one is unknown or no positive length; names it.
    """
    return limits_of(load_mapping(text, source, ('limits',)))


def limits_of(top: Fields) -> dict[str, float]:
    """The limits of a mapping that has the key `limits`.

    Raises:
        DescriptionError: there are none, one is unknown or no positive length; names it.
    """
    given = top.mapping('limits', tuple(LIMITED))
    if not given.content:
        raise top.refuse('limits', f'expected some of {", ".join(LIMITED)}')
    # a name first: what is unknown has no unit
    unknown = {str(name): 0.0 for name in given.content if name not in LIMITED}
    return checked_limits(
        unknown or {name: given.number(name) for name in given.content}, top.source
    )


def checked_limits(limits: Mapping[str, float], source: str = 'limits') -> dict[str, float]:
    """Limits (m) whose names are known.

    Raises:
        DescriptionError: one is unknown or no length that a calibrated arm could keep; names it.
    """
    for name, value in limits.items():
        if name not in LIMITED:
            raise DescriptionError(
                source, f'limits.{name}', f'unknown limit (known: {", ".join(LIMITED)})'
            )
        if not 0 < value <= FARTHEST:
            raise DescriptionError(
                source, f'limits.{name}', f'expected metres, from 0 to {FARTHEST:g}, got {value:g}'
            )
    return dict(limits)


def judge(limits: Mapping[str, float], quality: Record, source: str) -> list[Judged]:
    """How a quality record stands to limits, in their order.

    Raises:
        DataError: a limit is set for what these poses cannot tell; names it.
    """
    found = []
    for name, limit in limits.items():
        value: Record | float | None = quality
        for key in LIMITED[name]:
            value = value.get(key) if isinstance(value, dict) else None
        if not isinstance(value, float):
            raise DataError(
                f'{source}: {name} cannot be judged: too few poses or spheres to tell it by'
            )
        found.append(Judged(name, limit, abs(value)))
    return found
