# SPDX-License-Identifier: Apache-2.0
"""`/capture/markers`: gauge, program and what comes of it, as shapes for RViz and Foxglove."""

from __future__ import annotations

import time
from collections.abc import Sequence

from visualization_msgs.msg import MarkerArray

from calib_capture.nodes.capture_graph import CaptureNode
from calib_capture.nodes.messages import marker_array
from calib_capture.program import Marker, Program, gauge_markers, outcome_markers, program_markers
from calib_capture.recording import ProgramSession
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_MARKERS

PERIOD = 1.0  # s between two pictures of a run
SHARE = 0.02  # of the time may go into pictures


class MarkerPublisher:
    """Publishes whole pictures, latched: who comes late sees the last one."""

    def __init__(self, node: CaptureNode) -> None:
        self._node = node
        self._program: Program | None = None
        self._planned: list[Marker] = []
        self._due = 0.0
        self._publisher = node.create_publisher(
            MarkerArray, CAPTURE_MARKERS.relative, qos_of(CAPTURE_MARKERS)
        )

    def places(self) -> None:
        """The gauge wherever it stands."""
        self._publish(gauge_markers(self._node.gauge, self._node.placements))

    def program(self, program: Program) -> None:
        """What is going to be done."""
        node = self._node
        self._program = program
        self._planned = program_markers(program, node.arm, node.probe, node.gauge, node.placements)
        self._publish(self._planned)

    def progress(self, session: ProgramSession, last: bool = False) -> None:
        """What has come of it so far; now and then while somebody looks, and at the `last`."""
        begin = time.monotonic()
        if self._program is None or (begin < self._due and not last):
            return
        self._due = begin + PERIOD
        if not last and not self._publisher.get_subscription_count():
            return
        node = self._node
        done = outcome_markers(session.outcomes, self._program, node.arm, node.probe, node.gauge)
        self._publish([*self._planned, *done])
        now = time.monotonic()
        self._due = max(self._due, now + (now - begin) / SHARE)

    def _publish(self, markers: Sequence[Marker]) -> None:
        self._publisher.publish(marker_array(self._node.arm.base_frame, markers))
