# SPDX-License-Identifier: Apache-2.0
"""Between arrays and the messages of the graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Vector3
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker as MarkerMessage
from visualization_msgs.msg import MarkerArray

from calib_capture.markers import SPHERES, Color, Marker
from calib_capture.trajectory import Trajectory
from calib_model.pairing import usable
from calib_model.rotation import Array
from calib_model.topics import Topic

SECOND = 1_000_000_000


def qos_of(topic: Topic, best_effort: bool = False) -> QoSProfile:
    """The profile of a topic; `best_effort` for a subscriber that would rather miss than wait."""
    reliable = topic.reliable and not best_effort
    return QoSProfile(
        depth=topic.depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE,
    )


def described(text: str, dynamic: bool = False) -> ParameterDescriptor:
    """A parameter set at the start; `dynamic` takes `1` where 1.0 is meant, to be checked then."""
    return ParameterDescriptor(description=text, read_only=True, dynamic_typing=dynamic)


def time_of(stamp: int) -> Time:
    """A stamp in ns as a message."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def stamp_of(header: Header) -> int:
    """A header's stamp in ns."""
    return int(header.stamp.sec) * SECOND + int(header.stamp.nanosec)


def joint_state(
    stamp: int, frame: str, names: Sequence[str], position: Array, velocity: Array
) -> JointState:
    """A joint state of positions (n,) in rad and velocities (n,) in rad/s."""
    return JointState(
        header=Header(stamp=time_of(stamp), frame_id=frame),
        name=list(names),
        position=position.tolist(),
        velocity=velocity.tolist(),
    )


@cache
def _places(names: tuple[str, ...], wanted: tuple[str, ...]) -> tuple[int, ...] | None:
    if set(wanted) <= set(names):
        return tuple(names.index(name) for name in wanted)
    return None


def joints_of(state: JointState, names: tuple[str, ...]) -> Array | None:
    """The positions (n,) of the named joints, rad; None where one is missing or no number."""
    places = _places(tuple(state.name), names)
    if places is None or len(state.position) < len(state.name):
        return None
    joints: Array = np.array([state.position[i] for i in places])
    return joints if usable(joints) else None


def joint_trajectory(names: Sequence[str], trajectory: Trajectory) -> JointTrajectory:
    """A trajectory that starts when it is received."""
    points = []
    for seconds, position in zip(trajectory.seconds, trajectory.positions, strict=True):
        whole, rest = divmod(round(seconds * SECOND), SECOND)
        time = Duration(sec=int(whole), nanosec=int(rest))
        points.append(JointTrajectoryPoint(positions=position.tolist(), time_from_start=time))
    return JointTrajectory(joint_names=list(names), points=points)


def points_of(message: JointTrajectory) -> tuple[list[float], list[list[float]]]:
    """The times from the start, s, and the positions of a trajectory's points."""
    times = [point.time_from_start for point in message.points]
    seconds = [time.sec + time.nanosec / SECOND for time in times]
    return seconds, [list(point.positions) for point in message.points]


def marker_array(frame: str, markers: Sequence[Marker]) -> MarkerArray:
    """Shapes for RViz in the frame of the arm's base, in place of all that were there before."""
    header = Header(frame_id=frame)
    first = MarkerMessage(header=header, action=MarkerMessage.DELETEALL)
    return MarkerArray(markers=[first, *(_marker(header, marker) for marker in markers)])


def _marker(header: Header, marker: Marker) -> MarkerMessage:
    spheres = marker.kind == SPHERES
    width = marker.size
    message = MarkerMessage(
        header=header, ns=marker.group, id=marker.number, action=MarkerMessage.ADD,
        type=MarkerMessage.SPHERE_LIST if spheres else MarkerMessage.LINE_LIST,
        scale=Vector3(x=width, y=width, z=width) if spheres else Vector3(x=width),
        color=_color(marker.color),
        points=[Point(x=x, y=y, z=z) for x, y, z in marker.points.tolist()],
    )  # fmt: skip
    message.pose.orientation.w = 1.0
    return message


def _color(color: Color) -> ColorRGBA:
    red, green, blue, opacity = color
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)
