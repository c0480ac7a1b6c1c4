# SPDX-License-Identifier: Apache-2.0
"""The descriptions in a bag, the same ones from its beginning to its end, and the gauge's
temperature as a note tells it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from calib_model.bags import cdr
from calib_model.bags.reader import BagMessage, read_messages, read_note
from calib_model.bounds import TEMPERATURE
from calib_model.descriptions import (
    arm_yaml,
    gauge_yaml,
    parse_arm,
    parse_gauge,
    parse_probe,
    probe_yaml,
)
from calib_model.errors import BagError
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.topics import (
    ARM_DESCRIPTION,
    DESCRIPTIONS,
    GAUGE_DESCRIPTION,
    PROBE_DESCRIPTION,
    STRING,
    Topic,
)

T = TypeVar('T')
MOST_WORDINGS = 10  # of one description in one bag
TEMPERATURE_NOTE = 'gauge temperature'


class BagDescriptions:
    """Takes a bag's description messages and tells what they describe.

    A recording repeats them whenever a node is started anew, and in every file of a capture that
    was gone on with. Where they come to differ nobody knows which of them holds for a pose.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = path
        self._texts: dict[str, list[str]] = {}

    def __contains__(self, topic: object) -> bool:
        return topic in self._texts

    def take(self, message: BagMessage) -> None:
        """Take one message of one of the three topics.

        Raises:
            BagError: it is no text.
        """
        name = message.topic
        if message.type != STRING:
            raise BagError(f'{self._path}: topic {name} has type {message.type}, not {STRING}')
        try:
            text = cdr.text_of(message.data)
        except ValueError as error:
            raise BagError(f'{self._path}: {name}: {error}') from error
        texts = self._texts.setdefault(name, [])
        if text not in texts and len(texts) <= MOST_WORDINGS:
            texts.append(text)

    def arm(self) -> Arm:
        """The arm.

        Raises:
            BagError: the bag has none, or several.
            DescriptionError: it cannot be used.
        """
        return self._described(ARM_DESCRIPTION, parse_arm, arm_yaml)

    @property
    def has_arm(self) -> bool:
        """Whether the bag describes one."""
        return ARM_DESCRIPTION.name in self._texts

    def probe(self) -> Probe:
        """The probe; raises as `arm`."""
        return self._described(PROBE_DESCRIPTION, parse_probe, probe_yaml)

    def gauge(self) -> Gauge:
        """The gauge; raises as `arm`."""
        return self._described(GAUGE_DESCRIPTION, parse_gauge, gauge_yaml)

    def _described(
        self, topic: Topic, parse: Callable[[str, str], T], write: Callable[[T], str]
    ) -> T:
        if topic.name not in self._texts:
            raise BagError(f'{self._path}: the bag has no topic {topic.name}')
        texts = self._texts[topic.name]
        first, *others = (parse(text, f'{self._path}: {topic.name}') for text in texts)
        if len(texts) > MOST_WORDINGS or any(write(other) != write(first) for other in others):
            raise BagError(
                f'{self._path}: {topic.name} changes within the bag: '
                'which description holds for which pose cannot be told'
            )
        return first


def read_descriptions(path: str | Path) -> BagDescriptions:
    """The descriptions of a bag.

    Raises:
        BagError: no bag, or a message that cannot be read.
    """
    found = BagDescriptions(path)
    for message in read_messages(path, {topic.name for topic in DESCRIPTIONS}):
        found.take(message)
    return found


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
