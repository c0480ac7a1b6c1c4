# SPDX-License-Identifier: Apache-2.0
"""Between the simulation's arrays and the messages of the graph."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache

import numpy as np
from calib_interfaces.msg import StylusDisplacements
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from calib_model.rotation import Array
from calib_model.topics import Topic
from selfcenter_probe.health import Report
from selfcenter_probe.simulation import SECOND, Readings


def qos_of(topic: Topic, best_effort: bool = False) -> QoSProfile:
    """The profile of a topic; `best_effort` for a subscriber that would rather miss than wait."""
    reliable = topic.reliable and not best_effort
    return QoSProfile(
        depth=topic.depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


def stamp_of(state: JointState) -> int:
    """The stamp of a joint state in ns."""
    return int(state.header.stamp.sec) * SECOND + int(state.header.stamp.nanosec)


@cache
def _places(names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[int, ...] | None:
    if set(wanted) <= set(names):
        return tuple(names.index(name) for name in wanted)
    return None


def joints_of(state: JointState, names: Sequence[str]) -> Array | None:
    """The positions (n,) of the named joints, rad; None where one is missing or no number."""
    places = _places(tuple(state.name), tuple(names))
    if places is None or len(state.position) < len(state.name):
        return None
    joints: Array = np.array([state.position[i] for i in places])
    return joints if np.isfinite(joints).all() else None


def displacements(readings: Readings, frame: str) -> Iterator[StylusDisplacements]:
    """The readings' messages in their order: one object, filled anew, to be published at once.

    Making one for every reading would take as long as publishing it.
    """
    message = StylusDisplacements(header=Header(frame_id=frame))
    for stamp, displacement, status in zip(
        readings.stamp.tolist(), readings.displacement, readings.status, strict=True
    ):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        message.displacement = displacement
        message.status = status
        yield message


def joint_states(
    stamps: NDArray[np.int64], joints: Array, names: Sequence[str], frame: str
) -> Iterator[JointState]:
    """Joint states at stamps (M,), ns, with joints (M, n), rad: one object, as above."""
    message = JointState(header=Header(frame_id=frame), name=list(names))
    for stamp, q in zip(stamps.tolist(), joints, strict=True):
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
        message.position = q.tolist()
        yield message


def diagnostics(report: Report, probe: str, stamp: int) -> DiagnosticArray:
    """The health of the named probe at a stamp in ns."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    header = Header()
    header.stamp.sec, header.stamp.nanosec = seconds, nanoseconds
    status = DiagnosticStatus(
        level=bytes([report.level]), name=f'probe: {probe}', message=report.message,
        hardware_id=probe,
        values=[KeyValue(key=key, value=value) for key, value in report.values.items()],
    )  # fmt: skip
    return DiagnosticArray(header=header, status=[status])
