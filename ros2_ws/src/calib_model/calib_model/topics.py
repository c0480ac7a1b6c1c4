# SPDX-License-Identifier: Apache-2.0
"""The topics of the suite: name, type and quality of service, for nodes and bags alike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

JOINT_STATE = 'sensor_msgs/msg/JointState'
DISPLACEMENTS = 'calib_interfaces/msg/StylusDisplacements'
PROBING_POSE = 'calib_interfaces/msg/ProbingPose'
MEASURED_POINT = 'calib_interfaces/msg/MeasuredPoint'
STRING = 'std_msgs/msg/String'
QUALITY = 'calib_interfaces/msg/CaptureQuality'
MARKERS = 'visualization_msgs/msg/MarkerArray'
TRAJECTORY = 'trajectory_msgs/msg/JointTrajectory'

_FOREVER = {'sec': 9223372036, 'nsec': 854775807}


@dataclass(frozen=True)
class Topic:
    """A topic as its publisher offers it; `latched` is ROS 2's transient local durability."""

    name: str
    type: str
    depth: int = 100
    reliable: bool = True
    latched: bool = False

    @property
    def relative(self) -> str:
        """The name as nodes ask for it: in their namespace, which is / unless they are told."""
        return self.name.lstrip('/')

    def offered_qos(self) -> list[dict[str, Any]]:
        """The QoS profile in the words of rosbag2's metadata, version 9."""
        return [
            {
                'history': 'keep_last',
                'depth': self.depth,
                'reliability': 'reliable' if self.reliable else 'best_effort',
                'durability': 'transient_local' if self.latched else 'volatile',
                'deadline': dict(_FOREVER),
                'lifespan': dict(_FOREVER),
                'liveliness': 'automatic',
                'liveliness_lease_duration': dict(_FOREVER),
                'avoid_ros_namespace_conventions': False,
            }
        ]


JOINT_STATES = Topic('/joint_states', JOINT_STATE)
PROBE_DISPLACEMENTS = Topic('/probe/displacements', DISPLACEMENTS, reliable=False)
CAPTURE_POSES = Topic('/capture/poses', PROBING_POSE)
CAPTURE_POINTS = Topic('/capture/points', MEASURED_POINT)
CAPTURE_UNDONE = Topic('/capture/undone', PROBING_POSE)
ARM_DESCRIPTION = Topic('/arm_description', STRING, depth=1, latched=True)
PROBE_DESCRIPTION = Topic('/probe_description', STRING, depth=1, latched=True)
GAUGE_DESCRIPTION = Topic('/gauge_description', STRING, depth=1, latched=True)
ROBOT_DESCRIPTION = Topic('/robot_description', STRING, depth=1, latched=True)
CAPTURE_MARKERS = Topic('/capture/markers', MARKERS, depth=1, latched=True)
CAPTURE_QUALITY = Topic('/capture/quality', QUALITY, depth=1, latched=True)
SOLVER_MARKERS = Topic('/solver/markers', MARKERS, depth=1, latched=True)
DIAGNOSTICS = Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', depth=10)
CONTROLLER = 'arm_controller'
JOINT_TRAJECTORY = Topic(f'/{CONTROLLER}/joint_trajectory', TRAJECTORY, depth=1)


def commanded(controller: str) -> Topic:
    """Where a controller of that name takes trajectories."""
    return replace(JOINT_TRAJECTORY, name=JOINT_TRAJECTORY.name.replace(CONTROLLER, controller))


def follow_action(controller: str) -> str:
    """The action of a controller of that name, control_msgs/action/FollowJointTrajectory."""
    return commanded(controller).relative.replace('joint_trajectory', 'follow_joint_trajectory')


#: poses, and those that were taken back, by their stamps
POSE_TOPICS = (CAPTURE_POSES, CAPTURE_UNDONE)
DESCRIPTIONS = (ARM_DESCRIPTION, PROBE_DESCRIPTION, GAUGE_DESCRIPTION)


@dataclass(frozen=True)
class RawTopics:
    """Where the streams are, and `joints`, the arm's in its order by the names they have there."""

    joint_states: str = JOINT_STATES.name
    displacements: str = PROBE_DISPLACEMENTS.name
    joints: tuple[str, ...] = ()
