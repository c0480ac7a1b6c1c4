# SPDX-License-Identifier: Apache-2.0
"""Between arrays and the messages of the graph."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration
from calib_interfaces.msg import CaptureQuality, SphereQuality
from geometry_msgs.msg import Point, Vector3
from rcl_interfaces.msg import ParameterDescriptor
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA, Header
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import Marker as MarkerMessage, MarkerArray

from calib_capture.motion import Trajectory
from calib_capture.showing import SPHERES, Color, Marker, SphereProgress
from calib_model.arrays import Array
from calib_model.nodes import time_of
from calib_model.stamps import SECOND


def described(text: str, dynamic: bool = False) -> ParameterDescriptor:
    """A parameter set at the start; `dynamic` takes `1` where 1.0 is meant, to be checked then."""
    return ParameterDescriptor(description=text, read_only=True, dynamic_typing=dynamic)


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


def joint_trajectory(names: Sequence[str], trajectory: Trajectory) -> JointTrajectory:
    """A trajectory that starts at its stamp, or when it is received."""
    fields = {'positions': trajectory.positions}
    if trajectory.velocities is not None:
        fields['velocities'] = trajectory.velocities
    if trajectory.accelerations is not None:
        fields['accelerations'] = trajectory.accelerations
    points = []
    for row, seconds in enumerate(trajectory.seconds.tolist()):
        whole, rest = divmod(round(seconds * SECOND), SECOND)
        # arrays of doubles are taken as they are, lists looked at number by number
        given = {key: array('d', rows[row].tobytes()) for key, rows in fields.items()}
        time = Duration(sec=int(whole), nanosec=int(rest))
        points.append(JointTrajectoryPoint(time_from_start=time, **given))
    header = Header(stamp=time_of(trajectory.stamp))
    return JointTrajectory(header=header, joint_names=list(names), points=points)


def points_of(
    message: JointTrajectory,
) -> tuple[list[str], list[float], list[Any], list[Any], list[Any]]:
    """The joints' names, the times from the start, s, and positions, velocities and accelerations
    of a trajectory's points, empty where there are none."""
    points = message.points
    times = [point.time_from_start for point in points]
    return (
        list(message.joint_names),
        [time.sec + time.nanosec / SECOND for time in times],
        [point.positions for point in points],
        [point.velocities for point in points],
        [point.accelerations for point in points],
    )


def marker_array(frame: str, markers: Sequence[Marker]) -> MarkerArray:
    """Shapes for RViz in the frame of the arm's base, in place of all that were there before."""
    header = Header(frame_id=frame)
    first = MarkerMessage(header=header, action=MarkerMessage.DELETEALL)
    return MarkerArray(markers=[first, *(_marker(header, marker) for marker in markers)])


def capture_quality(
    stamp: int, frame: str, spheres: Sequence[SphereProgress], seconds_left: float
) -> CaptureQuality:
    """How a run is going, at a stamp (ns), in the frame of the arm's base."""
    refused: Counter[str] = Counter()
    for each in spheres:
        refused.update(each.refused)
    return CaptureQuality(
        header=Header(stamp=time_of(stamp), frame_id=frame),
        planned=sum(each.planned for each in spheres),
        taken=sum(each.taken for each in spheres),
        refused=refused.total(),
        reasons=list(refused),
        refused_by_reason=list(refused.values()),
        left=sum(each.left for each in spheres),
        seconds_left=seconds_left,
        two_sigma=_largest([each.two_sigma.nominal for each in spheres]),
        two_sigma_identified=_largest([each.two_sigma.identified for each in spheres]),
        spheres=[_sphere_quality(each) for each in spheres],
    )


def _sphere_quality(of: SphereProgress) -> SphereQuality:
    return SphereQuality(
        location=of.location,
        sphere=of.sphere,
        planned=of.planned,
        taken=of.taken,
        refused=sum(of.refused.values()),
        reasons=list(of.refused),
        refused_by_reason=list(of.refused.values()),
        left=of.left,
        two_sigma=of.two_sigma.nominal,
        two_sigma_identified=of.two_sigma.identified,
    )


def _largest(values: Sequence[Array]) -> float:
    """NaN where there is none."""
    known = [float(value.max()) for value in values if np.isfinite(value).all()]
    return max(known, default=float('nan'))


def _marker(header: Header, marker: Marker) -> MarkerMessage:
    spheres = marker.kind == SPHERES
    width = marker.size
    message = MarkerMessage(
        header=header,
        ns=marker.group,
        id=marker.number,
        action=MarkerMessage.ADD,
        type=MarkerMessage.SPHERE_LIST if spheres else MarkerMessage.LINE_LIST,
        scale=Vector3(x=width, y=width, z=width) if spheres else Vector3(x=width),
        color=_color(marker.color),
        points=[Point(x=x, y=y, z=z) for x, y, z in marker.points.tolist()],
    )
    message.pose.orientation.w = 1.0
    return message


def _color(color: Color) -> ColorRGBA:
    red, green, blue, opacity = color
    return ColorRGBA(r=red, g=green, b=blue, a=opacity)
