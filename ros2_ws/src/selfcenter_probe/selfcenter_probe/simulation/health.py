# SPDX-License-Identifier: Apache-2.0
"""The probe's health: what its readings of the last moments say about it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation.readings import Readings


class Level(IntEnum):
    """How bad it is, numbered as in diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


STATUSES = np.array(list(Status))


@dataclass(frozen=True)
class Report:
    """Level, one line, and named values as text."""

    level: Level
    message: str
    values: dict[str, str]


class Health:
    """Counts readings by status; a report is of those since the one before."""

    def __init__(self) -> None:
        self._readings = 0
        self._seen = np.zeros((3, len(Status)), np.int64)
        self._total = np.zeros((3, len(Status)), np.int64)
        self._displacement = np.zeros(3)
        self._status = np.full(3, Status.NO_CONTACT, np.uint8)

    def take(self, readings: Readings) -> None:
        """Take note of some readings."""
        if not len(readings):
            return
        self._readings += len(readings)
        self._seen += (readings.status[:, :, None] == STATUSES).sum(axis=0)
        self._displacement, self._status = readings.displacement[-1], readings.status[-1]

    def report(self, seconds: float) -> Report:
        """What the readings of the last `seconds` s say; counting starts again."""
        seen, count = self._seen, self._readings
        self._total += seen
        self._seen, self._readings = np.zeros_like(seen), 0
        level, message = _verdict(seen, count)
        return Report(level, message, self._values(count / seconds))

    def _values(self, rate: float) -> dict[str, str]:
        touching = bool((self._status != Status.NO_CONTACT).all())
        values = {'readings per second': f'{rate:.1f}', 'contact': str(touching)}
        for number in range(3):
            stylus = f'stylus {number + 1}'
            values[f'{stylus} signal'] = Status(int(self._status[number])).name
            values[f'{stylus} displacement (m)'] = f'{self._displacement[number]:.7f}'
            values[f'{stylus} over-travel readings'] = str(self._total[number, Status.OVER_TRAVEL])
            values[f'{stylus} weak readings'] = str(self._total[number, Status.WEAK_SIGNAL])
        return values


def _verdict(seen: NDArray[np.int64], count: int) -> tuple[Level, str]:
    if not count:
        return Level.STALE, 'no readings: no joint states from the arm'
    for status, level, what in (
        (Status.WEAK_SIGNAL, Level.ERROR, 'weak signal'),
        (Status.OVER_TRAVEL, Level.WARN, 'over-travel'),
    ):
        styli = [str(number + 1) for number in np.flatnonzero(seen[:, status])]
        if styli:
            return level, f'{what} of stylus {", ".join(styli)}'
    touched = int(seen[:, Status.OK].min())
    return Level.OK, 'reading' if touched else 'no contact'
