# SPDX-License-Identifier: Apache-2.0
"""Joint states and probe readings as they come in, and from whom."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from calib_interfaces.msg import StylusDisplacements
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from calib_capture.measuring import SourceError
from calib_capture.nodes.arm_commander import node_names
from calib_capture.nodes.capture.descriptions import Descriptions
from calib_capture.recording import Numbered, Origin, Publishers, several
from calib_model.nodes import joints_of, qos_of, stamp_of
from calib_model.pairing import JointSample, Reading
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, Topic

SILENT = 2.0  # s without a message after which one is waited for
#: messages that wait while a disk is slow: readings, and all of a hand-guided arm, which does not
#: stop for us
DEEP = 5000
Message = JointSample | Reading
Receiver = Callable[[Message, bytes, Origin], None]


class Streams:
    """Hands each message of both streams to `receiver`, with its CDR bytes and what is known of who
    published it. Without a receiver they are dropped, or kept for the next one where it `keeps`
    them. `watch` sees every message of which it is sure.
    """

    def __init__(self, node: Node, descriptions: Descriptions, keeps: bool) -> None:
        self._node, self._descriptions, self._keeps = node, descriptions, keeps
        self._origins = {JOINT_STATES: Publishers(), PROBE_DISPLACEMENTS: Publishers()}
        self._heard = dict.fromkeys(self._origins, 0.0)
        self._kept: list[tuple[Message, bytes, Origin]] = []
        self._listening = False
        self._receiver: Receiver | None = None
        self.watch: Callable[[Message], None] | None = None
        self.joint_names: Sequence[str] = ()

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

    def heard(self, topic: Topic) -> bool:
        """Whether a stream has begun."""
        return bool(self._heard[topic])

    def missing_joints(self) -> str:
        """The joint states, until one has come."""
        names = ', '.join(self.joint_names)
        return '' if self.heard(JOINT_STATES) else f'{JOINT_STATES.name} with {names}'

    def silent(self) -> str:
        """The streams from which nothing comes any more, and since when; empty when all do."""
        now = time.monotonic()
        return ', '.join(
            f'{topic.name}, silent for {now - heard:.0f} s'
            for topic, heard in self._heard.items()
            if heard and now - heard > SILENT
        )

    def lost(self) -> dict[str, int]:
        """How many messages of each did not arrive since they were counted anew."""
        return {topic.name: origin.lost for topic, origin in self._origins.items()}

    def count_anew(self) -> None:
        """From now on."""
        for origin in self._origins.values():
            origin.lost = 0

    def refuse_several(self) -> None:
        """Nothing, while each stream comes from one publisher.

        Raises:
            SourceError: one comes from several; names the nodes.
        """
        for topic, origin in self._origins.items():
            if origin.origin is Origin.SEVERAL:
                origin.forget()  # the next goal finds out anew
                raise SourceError(several(topic.name, self.publishers_of(topic)))

    def publishers_of(self, topic: Topic) -> str:
        """The nodes that publish a topic."""
        return node_names(lambda: self._node.get_publishers_info_by_topic(topic.relative))

    def _origin(self, topic: Topic, number: int | None, now: float) -> Origin:
        """Of the message of that number; unsure while a publisher that was started anew, perhaps
        with something else, may still have to describe it."""
        publishers = self._origins[topic]
        origin, left = publishers.see(number, now), publishers.left(now)
        if (
            origin is Origin.ONE
            and left is not None
            and self._descriptions.told_before(topic, left)
        ):
            return Origin.UNSURE
        return origin

    def _on_joints(self, raw: bytes, number: int | None) -> None:
        state = deserialize_message(raw, JointState)
        joints = joints_of(state, self.joint_names)
        if joints is None:
            self._origins[JOINT_STATES].pass_by(number)
            return
        now = time.monotonic()
        origin = self._origin(JOINT_STATES, number, now)
        self._heard[JOINT_STATES] = now
        self._take(JointSample(stamp_of(state.header), joints), raw, origin)

    def _on_reading(self, raw: bytes, number: int | None) -> None:
        now = time.monotonic()
        self._heard[PROBE_DISPLACEMENTS] = now
        origin = self._origin(PROBE_DISPLACEMENTS, number, now)
        if self._receiver is None and self.watch is None and not self._keeps:
            return
        message = deserialize_message(raw, StylusDisplacements)
        first, second, third = message.status.tolist()
        reading = Reading(stamp_of(message.header), message.displacement, (first, second, third))
        self._take(reading, raw, origin)

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
