# SPDX-License-Identifier: Apache-2.0
"""What arm, probe and gauge are: by files where these are named, else by their topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import TypeVar

from rclpy.node import Node
from std_msgs.msg import String

from calib_capture.measuring import SourceError
from calib_model.descriptions import (
    Standing,
    parse_arm,
    parse_gauge,
    parse_probe,
    parse_standing,
    read_description,
)
from calib_model.instruments import Arm, Gauge, Probe, refuse_misfit
from calib_model.nodes import qos_of
from calib_model.topics import (
    ARM_DESCRIPTION,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
    Topic,
)

T = TypeVar('T')
TOPICS = {'arm': ARM_DESCRIPTION, 'probe': PROBE_DESCRIPTION, 'gauge': GAUGE_DESCRIPTION}
#: what a stream's messages cannot be understood without
DESCRIBED_BY = {JOINT_STATES: ('arm',), PROBE_DISPLACEMENTS: ('probe', 'gauge')}


class Descriptions:
    """Gathers them; `paths` of files are empty where a topic tells.

    `simulated` is what a probe that a file describes says of itself on its topic. `changed` tells
    whether one is described in another way than before.
    """

    def __init__(self, node: Node, paths: Mapping[str, str]) -> None:
        self._node, self._paths = node, paths
        self._texts: dict[str, str] = {}
        self._told: dict[str, float] = {}  # when each was described last, s
        self._changed: set[str] = set()
        self._arm_says = ''
        self.simulated = False
        for key, topic in TOPICS.items():
            if not paths[key]:
                self._hear(topic, self._keeping(key))
        if paths['probe']:  # the file says what it is, and the topic if it is real
            self._hear(PROBE_DESCRIPTION, self._note_simulated)
        if paths['arm']:  # how long it stands for a pose it may say all the same
            self._hear(ARM_DESCRIPTION, self._note_arm)

    def _hear(self, topic: Topic, take: Callable[[String], None]) -> None:
        self._node.create_subscription(String, topic.relative, take, qos_of(topic))

    def _keeping(self, key: str) -> Callable[[String], None]:
        def keep(message: String) -> None:
            self._told[key] = time.monotonic()
            if self._texts.setdefault(key, message.data) != message.data:
                self._changed.add(key)

        return keep

    def _note_simulated(self, message: String) -> None:
        self.simulated = self.simulated or 'simulated: true' in message.data.splitlines()

    def _note_arm(self, message: String) -> None:
        self._arm_says = message.data

    def missing(self) -> str:
        """The topics of those that have not come; empty when all have."""
        missing = [
            topic.name
            for key, topic in TOPICS.items()
            if not self._paths[key] and key not in self._texts
        ]
        return ', '.join(missing)

    def read(self) -> tuple[Arm, Probe, Gauge]:
        """All three, when none is missing.

        Raises:
            DescriptionError: one cannot be used.
            DataError: the gauge's spheres do not sit in the probe.
        """
        arm = self._read('arm', parse_arm)
        probe, gauge = self._read('probe', parse_probe), self._read('gauge', parse_gauge)
        refuse_misfit(probe, gauge)
        return arm, probe, gauge

    def _read(self, key: str, parse: Callable[[str, str], T]) -> T:
        if self._paths[key]:
            return read_description(self._paths[key], parse)
        return parse(self._texts[key], TOPICS[key].name)

    def standing(self) -> Standing | None:
        """How long the arm is to stand for a pose, as its file or it itself says."""
        if not self._paths['arm']:
            return parse_standing(self._texts['arm'], ARM_DESCRIPTION.name)
        said = parse_standing(self._arm_says, ARM_DESCRIPTION.name) if self._arm_says else None
        return read_description(self._paths['arm'], parse_standing) or said

    @property
    def changed(self) -> bool:
        """Whether one is described in another way than before."""
        return bool(self._changed)

    def refuse_change(self, publishers_of: Callable[[Topic], str]) -> None:
        """Nothing, while each stays as it was.

        Raises:
            SourceError: another one came; names the nodes that describe it.
        """
        for key in sorted(self._changed):
            topic = TOPICS[key]
            raise SourceError(
                f'{topic.name}: another {key} than before is described there, by '
                f'{publishers_of(topic)}; start the capture anew for it'
            )

    def told_before(self, topic: Topic, instant: float) -> bool:
        """Whether what a stream is understood by was described before an instant (s)."""
        return any(self._told.get(key, instant) < instant for key in DESCRIBED_BY[topic])
