# SPDX-License-Identifier: Apache-2.0
"""A probe node for tests: it knows no world but an arm and a gauge as they should be."""

from __future__ import annotations

import time

import numpy as np
import rclpy
from calib_interfaces.msg import ProbingPose, StylusDisplacements
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_model.descriptions import gauge_yaml, probe_yaml
from calib_model.kinematics import points
from calib_model.nodes import joints_of, qos_of, stamp_of, time_of
from calib_model.topics import (
    CAPTURE_POSES,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
)


class PerfectProbe:
    """A probe on a perfect arm with the gauge just where it should be.

    `blind` readings in a row are not sent, as when the network drops them.
    """

    def __init__(self, domain, arm, probe, gauge, placements):
        self.arm, self.probe, self.gauge = arm, probe, gauge
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('probe', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.latched = []
        for topic, text in (
            (PROBE_DESCRIPTION, probe_yaml(probe)),
            (GAUGE_DESCRIPTION, gauge_yaml(gauge)),
        ):
            publisher = self.node.create_publisher(String, topic.name, qos_of(topic))
            publisher.publish(String(data=text))
            self.latched.append(publisher)
        centers = np.array([center for _, center in gauge.spheres])
        self.spheres = np.concatenate([place.apply(centers) for place in placements.values()])
        self.publisher = self.node.create_publisher(
            StylusDisplacements, PROBE_DISPLACEMENTS.name, qos_of(PROBE_DISPLACEMENTS)
        )
        self.node.create_subscription(
            JointState, JOINT_STATES.name, self.read, qos_of(JOINT_STATES, best_effort=True)
        )
        self.poses = []
        self.node.create_subscription(
            ProbingPose, CAPTURE_POSES.name, self.poses.append, qos_of(CAPTURE_POSES)
        )
        self.before = None
        self.silent = lambda joints: False

    def read(self, state):
        """Three readings between two states of an arm at rest, one where it has arrived."""
        joints, stamp = joints_of(state, self.arm.joint_names), stamp_of(state.header)
        resting = self.before is not None and np.abs(joints - self.before[1]).max() < 1e-9
        stamps = [stamp]
        if resting and stamp - self.before[0] < 1e8:
            stamps = np.linspace(self.before[0], stamp, 4)[1:].astype(int).tolist()
        self.before = stamp, joints
        if self.silent(joints):
            return
        displacement, status = self.touched(joints)
        for each in stamps:
            message = StylusDisplacements(displacement=displacement, status=status)
            message.header.stamp = time_of(each)
            self.publisher.publish(message)

    def touched(self, joints):
        flange_T_probe = self.probe.flange_T_probe.matrix()
        origin, x, y, z = (
            points(self.arm, joints, (flange_T_probe @ np.append(p, 1.0))[:3])[0]
            for p in (np.zeros(3), *np.eye(3))
        )
        nearest = self.spheres[np.argmin(np.linalg.norm(self.spheres - origin, axis=1))]
        p_probe = np.stack([x - origin, y - origin, z - origin]) @ (nearest - origin)
        s = self.probe.displacements(p_probe[None], self.gauge.sphere_diameter)[0]
        if np.isnan(s).any() or (s < self.probe.stroke[:, 0]).any():
            return np.zeros(3), np.ones(3, dtype=np.uint8)
        return s, np.where(s > self.probe.stroke[:, 1], 2, 0).astype(np.uint8)

    def spin_while(self, process, seconds=90.0):
        end = time.monotonic() + seconds
        while process.poll() is None:
            assert time.monotonic() < end, 'the capture does not end'
            self.executor.spin_once(timeout_sec=0.05)

    def close(self):
        self.node.destroy_node()
        self.executor.shutdown()
        self.context.shutdown()
