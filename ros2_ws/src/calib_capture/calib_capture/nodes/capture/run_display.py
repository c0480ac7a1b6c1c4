# SPDX-License-Identifier: Apache-2.0
"""`/capture/markers` and `/capture/quality`: what comes of a program, to be seen while it runs."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence

from calib_interfaces.msg import CaptureQuality
from rclpy.duration import Duration
from rclpy.publisher import Publisher
from visualization_msgs.msg import MarkerArray

from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.nodes.messages import capture_quality, marker_array
from calib_capture.program import Program
from calib_capture.recording import HandGuidedSession, ProgramSession, TakingSession
from calib_capture.showing import (
    HandGuidedProgress,
    Marker,
    RunProgress,
    SphereProgress,
    gauge_markers,
    outcome_markers,
    program_markers,
)
from calib_model.measurement import ProbingSet
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_MARKERS, CAPTURE_QUALITY

PERIOD = 1.0  # s between two pictures of a run
SHARE = 0.01  # of the time may go into each of both
LAST_WORDS = 0.5  # s for those who listen to get the last one


class RunDisplay:
    """Publishes whole pictures and figures, latched: who comes late sees the last ones."""

    def __init__(self, node: CaptureNode) -> None:
        self._node = node
        self._program: Program | None = None
        self._planned: list[Marker] = []
        self._progress: RunProgress | None = None
        self._by_hand: HandGuidedProgress | None = None
        self._markers = _Paced(
            node.create_publisher(MarkerArray, CAPTURE_MARKERS.relative, qos_of(CAPTURE_MARKERS))
        )
        self._quality = _Paced(
            node.create_publisher(CaptureQuality, CAPTURE_QUALITY.relative, qos_of(CAPTURE_QUALITY))
        )

    def places(self) -> None:
        """The gauge wherever it stands."""
        self._show(gauge_markers(self._node.gauge, self._node.placements))

    def program(self, program: Program) -> None:
        """What is going to be done, from here on where a run is under way."""
        node = self._node
        self._program = program
        if self._progress is not None:
            self._progress.plan_anew(program)
        self._planned = program_markers(program, node.arm, node.probe, node.gauge, node.placements)
        self._show(self._planned)

    def begin(self, earlier: ProbingSet | None) -> None:
        """A run of the program begins, with a bag that has these poses."""
        node = self._node
        assert self._program is not None
        self._progress = RunProgress(self._program, node.arm, node.probe, node.gauge, earlier)

    def progress(self, session: ProgramSession, last: bool = False) -> None:
        """What has come of it so far; now and then while somebody looks, and at the `last`."""
        for what, show in (
            (self._markers, self._show_outcomes),
            (self._quality, self._show_quality),
        ):
            begin = time.monotonic()
            if last or what.due(begin):
                show(session)
                what.shown(begin)
            if last:
                what.publisher.wait_for_all_acked(Duration(seconds=LAST_WORDS))

    def begin_hand_guided(
        self, planned: Mapping[tuple[int, int], int], earlier: ProbingSet | None
    ) -> None:
        """A hand-guided arm begins, with so many poses planned by location and sphere."""
        node = self._node
        self._by_hand = HandGuidedProgress(planned, node.arm, node.probe, node.gauge, earlier)

    def hand_guided(self, session: HandGuidedSession | TakingSession, last: bool = False) -> None:
        """As `progress`, of an arm that is led by hand: how it is going, in figures."""
        begin = time.monotonic()
        if self._by_hand is not None and (last or self._quality.due(begin)):
            self._publish(self._by_hand.spheres(session.poses), math.nan)
            self._quality.shown(begin)
        if last:
            self._quality.publisher.wait_for_all_acked(Duration(seconds=LAST_WORDS))

    def _show_outcomes(self, session: ProgramSession) -> None:
        node, run = self._node, session.run
        done = outcome_markers(run.taken, run.refused, node.arm, node.probe, node.gauge)
        self._show([*self._planned, *done])

    def _show_quality(self, session: ProgramSession) -> None:
        assert self._progress is not None
        spheres = self._progress.spheres(session.run)
        self._publish(spheres, session.run.seconds_left(time.monotonic()))

    def _publish(self, spheres: Sequence[SphereProgress], left: float) -> None:
        self._quality.publisher.publish(
            capture_quality(time.time_ns(), self._node.arm.base_frame, spheres, left)
        )

    def _show(self, markers: Sequence[Marker]) -> None:
        self._markers.publisher.publish(marker_array(self._node.arm.base_frame, markers))


class _Paced:
    """When it is time for the next message of a publisher."""

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self._due = 0.0

    def due(self, now: float) -> bool:
        """Whether somebody waits for one."""
        return now >= self._due and bool(self.publisher.get_subscription_count())

    def shown(self, begin: float) -> None:
        """One was made, from `begin` on."""
        now = time.monotonic()
        self._due = max(begin + PERIOD, now + (now - begin) / SHARE)
