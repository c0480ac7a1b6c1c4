# SPDX-License-Identifier: Apache-2.0
"""`/capture/teach`: the arm stands on a sphere, and the node takes note of where that is."""

from __future__ import annotations

import math
import time
from collections import deque

from calib_interfaces.srv import Teach

from calib_capture.nodes.capture.graph import CaptureNode
from calib_capture.nodes.capture.run_display import RunDisplay
from calib_capture.program import (
    TaughtBook,
    TaughtSphere,
    TeachError,
    probed_sphere,
    taught_location,
)
from calib_capture.recording import pose_at_rest
from calib_model.errors import CalibrationError
from calib_model.pairing import JointSample, Reading, SteadySettings

WINDOW = 0.3  # s that the arm and the styli must have been steady, and are averaged
SILENT = 1.0  # s without a joint state after which the arm counts as gone
KEPT = 2000  # messages of each stream


class TeachService:
    """Keeps the last moments of both streams and the spheres taught so far, by location.

    Raises:
        DescriptionError: the file of what was taught before is there and cannot be read.
    """

    def __init__(self, node: CaptureNode, showing: RunDisplay) -> None:
        self._node = node
        self._showing = showing
        self._book = TaughtBook(node.asked.taught)
        node.taught.update(self._book.read())
        if node.taught:
            numbers = ', '.join(map(str, sorted(node.taught)))
            node.get_logger().info(f'{node.asked.taught}: taught locations {numbers}')
        self._joints: deque[JointSample] = deque(maxlen=KEPT)
        self._readings: deque[Reading] = deque(maxlen=KEPT)
        self._heard = -math.inf
        self._spheres: dict[int, dict[int, TaughtSphere]] = {}
        self.busy = False  # a capture is under way
        node.streams.watch = self._see
        node.create_service(Teach, 'capture/teach', self._teach)

    def _see(self, message: JointSample | Reading) -> None:
        if isinstance(message, JointSample):
            self._heard = time.monotonic()
            self._joints.append(message)
        else:
            self._readings.append(message)

    def _teach(self, request: Teach.Request, response: Teach.Response) -> Teach.Response:
        response.length_error = math.nan
        try:
            response.message = self._taught(request.location, request.sphere, response)
            response.success = True
        except CalibrationError as error:
            response.message = str(error)
        self._node.get_logger().info(response.message)
        return response

    def _taught(self, location: int, number: int, response: Teach.Response) -> str:
        if location < 1:
            raise TeachError('location 0: locations are counted from 1')
        sphere = self._probed(location, number)
        response.center = sphere.p_base_sphere
        here = self._spheres.setdefault(location, {})
        here[number] = sphere
        # a place that was taught before does not hold for what is taught now
        if self._node.taught.pop(location, None) is not None:
            self._book.write(self._node.taught, self._node.arm.base_frame)
        if len(here) < 2:
            return f'location {location}: sphere {number} taught, one more to go'
        first, last = self._ends(here)
        gauge = self._node.gauge
        response.length_error = self._length_error(first, last)
        taught = taught_location(gauge, location, first, last)
        self._node.taught[location] = taught.T_base_gauge
        self._showing.places()
        kept = self._book.write(self._node.taught, self._node.arm.base_frame)
        return (
            f'location {location}: taught by spheres {first.number} and {last.number}, '
            f'{response.length_error * 1e3:+.3f} mm off the certificate, {kept}'
        )

    def _probed(self, location: int, number: int) -> TaughtSphere:
        node = self._node
        if self.busy and node.awaits is None:
            raise TeachError('a capture is under way: teach when it is done')
        if node.awaits not in (None, location):
            raise TeachError(f'the bar is to stand at location {node.awaits} now: teach that')
        if missing := node.descriptions.missing():
            raise TeachError(f'not there yet: {missing}')
        node.refuse_strangers()
        if time.monotonic() - self._heard > SILENT:
            raise TeachError('no joint states from the arm')
        asked = node.asked.steady
        settings = SteadySettings(
            settle=0.0,
            dwell=WINDOW,
            max_speed=asked.max_speed,
            max_spread=asked.max_spread,
            max_gap=asked.max_gap,
            min_readings=asked.min_readings,
        )
        pose = pose_at_rest(list(self._joints), list(self._readings), settings)
        return probed_sphere(
            node.arm, node.probe, node.gauge, number, pose.joints, pose.displacement
        )

    def _ends(self, taught: dict[int, TaughtSphere]) -> tuple[TaughtSphere, TaughtSphere]:
        """The two taught spheres that are farthest apart on the certificate, in its order."""
        gauge = self._node.gauge
        pairs = [(a, b) for a in taught for b in taught if a < b]
        first, last = max(pairs, key=lambda ab: math.dist(gauge.center(ab[0]), gauge.center(ab[1])))
        return taught[first], taught[last]

    def _length_error(self, first: TaughtSphere, last: TaughtSphere) -> float:
        gauge = self._node.gauge
        certified = math.dist(gauge.center(first.number), gauge.center(last.number))
        return math.dist(first.p_base_sphere, last.p_base_sphere) - certified
