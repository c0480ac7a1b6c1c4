# SPDX-License-Identifier: Apache-2.0
"""Joint states and probe readings as they come in, and from whom."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from calib_interfaces.msg import StylusDisplacements
from rclpy.node import Node
from sensor_msgs.msg import JointState

from calib_capture.measuring import SourceError
from calib_capture.nodes.arm_commander import node_names
from calib_capture.nodes.capture.descriptions import Descriptions
from calib_capture.recording import (
    JointStateReader,
    Numbered,
    Origin,
    Publishers,
    read_reading,
    several,
)
from calib_model.nodes import qos_of
from calib_model.pairing import JointSample, Reading
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, Topic

SILENT = 2.0  # s without a message after which one is waited for
#: messages that wait while a disk is slow: readings, and all of a hand-guided arm, which does not
#: stop for us
DEEP = 5000
Message = JointSample | Reading
Receiver = Callable[[Message, bytes, Origin], None]


class Stream:
    """One of both: who publishes it, and when it was `heard` last (s), 0 before."""

    def __init__(self, topic: Topic, descriptions: Descriptions) -> None:
        self.topic, self._descriptions = topic, descriptions
        self.publishers = Publishers()
        self.heard = 0.0

    def see(self, number: int | None, now: float) -> Origin:
        """One more message, of that number, that has come `now` (s): of whom; unsure while a
        publisher that was started anew, perhaps with something else, may still have to describe
        it."""
        self.heard = now
        origin, left = self.publishers.see(number, now), self.publishers.left(now)
        if origin is not Origin.ONE or left is None:
            return origin
        return Origin.UNSURE if self._descriptions.told_before(self.topic, left) else origin


class Streams:
    """Hands each message of both streams to `receiver`, with its CDR bytes and what is known of who
    published it. Without a receiver they are dropped, or kept for the next one where it `keeps`
    them. `watch` sees every message of which it is sure.
    """

    def __init__(self, node: Node, descriptions: Descriptions, keeps: bool) -> None:
        self._node, self._descriptions, self._keeps = node, descriptions, keeps
        self._joints = Stream(JOINT_STATES, descriptions)
        self._readings = Stream(PROBE_DISPLACEMENTS, descriptions)
        self._both = (self._joints, self._readings)
        self._kept: list[tuple[Message, bytes, Origin]] = []
        self._listening = False
        self._receiver: Receiver | None = None
        self.watch: Callable[[Message], None] | None = None
        self.of_joints(())

    def of_joints(self, names: Sequence[str]) -> None:
        """These joints are taken from the joint states."""
        self._names, self._reader = names, JointStateReader(names)

    def listen(self, led: bool) -> None:
        """Take in both from now on, of an arm that is `led` by hand or commanded."""
        if self._listening:
            return
        self._listening = True
        for kind, topic, take in (
            (JointState, JOINT_STATES, self._on_joints),
            (StylusDisplacements, PROBE_DISPLACEMENTS, self._on_reading),
        ):
            qos = qos_of(topic, best_effort=True)
            if led or topic is PROBE_DISPLACEMENTS:
                qos.depth = DEEP
            self._node.create_subscription(kind, topic.relative, Numbered(take), qos, raw=True)

    def receive(self, receiver: Receiver) -> None:
        """Hand on what was kept, and all that comes from now on."""
        self._receiver = receiver
        kept, self._kept = self._kept, []
        for each in kept:
            self._pass_on(*each)

    def leave(self) -> None:
        """Nobody receives any more."""
        self._receiver = None

    def forget(self) -> None:
        """What was kept is of no use."""
        self._kept.clear()

    @property
    def has_readings(self) -> bool:
        """Whether a reading has come."""
        return bool(self._readings.heard)

    def missing_joints(self) -> str:
        """The joint states, until one has come."""
        return '' if self._joints.heard else f'{JOINT_STATES.name} with {", ".join(self._names)}'

    def silent(self) -> str:
        """The streams from which nothing comes any more, and since when; empty when all do."""
        now = time.monotonic()
        return ', '.join(
            f'{each.topic.name}, silent for {now - each.heard:.0f} s'
            for each in self._both
            if each.heard and now - each.heard > SILENT
        )

    def lost(self) -> dict[str, int]:
        """How many messages of each did not arrive since they were counted anew."""
        return {each.topic.name: each.publishers.lost for each in self._both}

    def count_anew(self) -> None:
        """From now on."""
        for each in self._both:
            each.publishers.lost = 0

    def refuse_several(self) -> None:
        """Nothing, while each stream comes from one publisher.

        Raises:
            SourceError: one comes from several; names the nodes.
        """
        for each in self._both:
            if each.publishers.origin is Origin.SEVERAL:
                each.publishers.forget()  # the next goal finds out anew
                raise SourceError(several(each.topic.name, self.publishers_of(each.topic)))

    def publishers_of(self, topic: Topic) -> str:
        """The nodes that publish a topic."""
        return node_names(lambda: self._node.get_publishers_info_by_topic(topic.relative))

    def _on_joints(self, raw: bytes, number: int | None) -> None:
        sample = self._reader.read(raw)
        if sample is None:
            self._joints.publishers.pass_by(number)
            return
        self._take(sample, raw, self._joints.see(number, time.monotonic()))

    def _on_reading(self, raw: bytes, number: int | None) -> None:
        origin = self._readings.see(number, time.monotonic())
        if self._receiver is not None or self.watch is not None or self._keeps:
            self._take(read_reading(raw), raw, origin)

    def _take(self, message: Message, raw: bytes, origin: Origin) -> None:
        if self.watch is not None and origin is Origin.ONE:
            self.watch(message)
        if self._receiver is not None:
            self._pass_on(message, raw, origin)
        elif self._keeps:
            self._kept.append((message, raw, origin))

    def _pass_on(self, message: Message, raw: bytes, origin: Origin) -> None:
        # after a change, until somebody sees to it: this may be of what nobody described to us
        if self._receiver is not None and not self._descriptions.changed:
            self._receiver(message, raw, origin)
