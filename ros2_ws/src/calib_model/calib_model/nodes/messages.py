# SPDX-License-Identifier: Apache-2.0
"""Between the messages of the graph and plain values: QoS, joints, stamps."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from calib_model.arrays import Array
from calib_model.pairing import usable
from calib_model.stamps import SECOND
from calib_model.topics import Topic


def qos_of(topic: Topic, best_effort: bool = False) -> QoSProfile:
    """The profile of a topic; `best_effort` for a subscriber that would rather miss than wait."""
    reliable = topic.reliable and not best_effort
    return QoSProfile(
        depth=topic.depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


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
    return joints if usable(joints) else None


def time_of(stamp: int) -> Time:
    """A stamp in ns as a message."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def stamp_of(header: Header) -> int:
    """A header's stamp in ns."""
    return int(header.stamp.sec) * SECOND + int(header.stamp.nanosec)
