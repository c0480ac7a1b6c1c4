# SPDX-License-Identifier: Apache-2.0
"""The arm in a process of its own, spoken to over DDS."""

from __future__ import annotations

import signal
import time

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory

from calib_capture.motion import Trajectory
from calib_capture.nodes.messages import joint_trajectory
from calib_model.descriptions import parse_arm
from calib_model.nodes import (
    qos_of,
    stamp_of,
)
from calib_model.topics import ARM_DESCRIPTION, JOINT_STATES, JOINT_TRAJECTORY, ROBOT_DESCRIPTION

pytestmark = [pytest.mark.system, pytest.mark.timeout(90)]
MODULE = 'calib_capture.nodes.arm_node'


class Peer:
    """Hears the arm's states and commands it."""

    def __init__(self, domain, arm):
        self.arm = arm
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('peer', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.states = []
        self.texts = {}
        qos = qos_of(JOINT_STATES)
        qos.depth = 2000  # however busy the machine is
        self.node.create_subscription(JointState, JOINT_STATES.name, self.states.append, qos)
        for topic in (ARM_DESCRIPTION, ROBOT_DESCRIPTION):
            self.node.create_subscription(
                String,
                topic.name,
                lambda m, name=topic.name: self.texts.update({name: m.data}),
                qos_of(topic),
            )
        self.publisher = self.node.create_publisher(
            JointTrajectory, JOINT_TRAJECTORY.name, qos_of(JOINT_TRAJECTORY)
        )

    def until(self, condition, seconds=20.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, 'nothing came'
            self.executor.spin_once(timeout_sec=0.05)

    def spin(self, seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def ready(self):
        self.until(lambda: self.states and self.publisher.get_subscription_count())

    def command(self, seconds, positions, names=None):
        trajectory = Trajectory(np.array(seconds, dtype=float), np.array(positions, dtype=float))
        self.publisher.publish(joint_trajectory(names or self.arm.joint_names, trajectory))

    def arrays(self):
        q = np.array([state.position for state in self.states])
        stamps = np.array([stamp_of(state.header) for state in self.states])
        return (stamps - stamps[0]) / 1e9, q

    def close(self):
        self.node.destroy_node()
        self.executor.shutdown()
        self.context.shutdown()


@pytest.fixture
def peer(domain, kr5, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    peer = Peer(domain, kr5)
    yield peer
    peer.close()


@pytest.fixture
def arm_file(config):
    return config / 'arms' / 'kuka_kr5_sixx_r650.yaml'


GOAL = [0.5, 0.4, -0.3, 0.2, 0.6, -0.8]


def test_the_arm_follows_at_its_rate_within_its_speeds(graph, peer, arm_file, kr5):
    graph.start(MODULE, arm=arm_file, time_scale=5, rate=100)
    peer.ready()
    del peer.states[:]
    peer.command([0.01, 1.0], [GOAL, np.zeros(6)])
    peer.spin(1.0)
    stamps, q = peer.arrays()
    assert 60 <= len(q) <= 115
    assert 4.0 <= stamps[-1] - stamps[0] <= 6.5  # five seconds for the arm
    assert np.abs(q - GOAL).max(axis=1).min() < 0.3
    assert np.abs(q[-1]).max() < 1e-9
    steps = np.abs(np.diff(q, axis=0)) / np.diff(stamps)[:, None]
    assert (steps <= kr5.velocity * (1 + 1e-4)).all()  # stamps are whole nanoseconds


def test_both_descriptions_are_there_for_whoever_comes_late(graph, peer, arm_file, kr5):
    graph.start(MODULE, arm=arm_file)
    peer.until(lambda: len(peer.texts) == 2)
    assert parse_arm(peer.texts['/arm_description']) == kr5
    assert '<robot' in peer.texts['/robot_description']


def test_a_new_trajectory_replaces_the_old_and_an_empty_one_stops(graph, peer, arm_file):
    graph.start(MODULE, arm=arm_file, rate=100)
    peer.ready()
    peer.command([30.0], [GOAL])
    peer.spin(0.4)
    peer.command([0.5], [[0.0] * 5 + [0.3]])
    peer.until(lambda: abs(peer.states[-1].position[5] - 0.3) < 1e-9)
    assert np.abs(np.array(peer.states[-1].position)[:5]).max() < 1e-9
    peer.command([30.0], [GOAL])
    peer.spin(0.4)
    peer.publisher.publish(JointTrajectory(joint_names=list(peer.arm.joint_names)))
    peer.spin(0.3)
    del peer.states[:]
    peer.spin(0.3)
    _, q = peer.arrays()
    assert np.ptp(q, axis=0).max() == 0
    assert np.abs(q[0] - GOAL).max() > 0.1
    assert not np.any(peer.states[-1].velocity)


def test_a_bad_trajectory_is_refused_with_one_line_and_the_arm_stays(graph, peer, arm_file):
    process = graph.start(MODULE, arm=arm_file, rate=100)
    peer.ready()
    peer.command([1.0], [[9.0] * 6])
    peer.spin(0.5)
    peer.command([1.0], [GOAL], names=[f'other_{i}' for i in range(6)])
    peer.spin(0.5)
    assert not np.any(peer.states[-1].position)
    peer.command([0.2], [GOAL])
    peer.until(lambda: np.allclose(peer.states[-1].position, GOAL))
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=10)
    refusals = [line for line in said.splitlines() if 'refused' in line]
    assert process.returncode == 0
    assert 'joint_a1 out of its limits' in refusals[0]
    assert all('other_0' in line for line in refusals[1:])
    assert len(refusals) == 2
    assert 'Traceback' not in said


def test_stepped_a_minute_of_motion_is_over_at_once(graph, peer, arm_file):
    graph.start(MODULE, arm=arm_file, time_scale=0)
    peer.ready()
    begin = time.monotonic()
    before = stamp_of(peer.states[-1].header)
    peer.command([30.0, 30.06, 60.0, 60.06], [GOAL, GOAL, [0.0] * 6, [0.0] * 6])
    peer.until(lambda: stamp_of(peer.states[-1].header) - before > 60e9)
    assert time.monotonic() - begin < 5.0
    stamps, q = peer.arrays()
    there = np.flatnonzero(np.abs(q - GOAL).max(axis=1) < 1e-9)
    assert len(there) == 3  # start, middle and end of the rest
    assert np.allclose(np.diff(stamps[there]), 0.03)
    assert (np.diff(stamps) > 0).all()


def test_stepped_a_long_trajectory_arrives_whole(graph, peer, arm_file):
    """Three hundred poses at once, with a rest at each: more states than a publisher keeps."""
    graph.start(MODULE, arm=arm_file, time_scale=0)
    peer.ready()
    targets = np.random.default_rng(1).uniform(-0.5, 0.5, (300, 6))
    del peer.states[:]
    arrivals = 0.5 * np.arange(1, 301)
    seconds = np.stack([arrivals, arrivals + 0.1], axis=1).ravel()
    peer.command(seconds, np.repeat(targets, 2, axis=0))
    peer.until(lambda: np.allclose(peer.states[-1].position if peer.states else 9, targets[-1]))
    _, q = peer.arrays()
    missed = [target for target in targets if np.abs(q - target).max(axis=1).min() > 1e-8]
    assert missed == []


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'arm': '/nowhere/arm.yaml'}, '/nowhere/arm.yaml: cannot be read'),
        ({'rate': -3}, "parameter 'rate': expected a number from 1 to 1000, got -3"),
        ({'time_scale': 'fast'}, "parameter 'time_scale': expected a number"),
        ({'arm': 7}, 'arm'),
    ],
)
def test_bad_parameters_end_it_with_two_and_one_line(graph, arm_file, parameters, said):
    process = graph.start(MODULE, **{'arm': arm_file, **parameters})
    _, error = process.communicate(timeout=30)
    assert process.returncode == 2
    assert said in error
    assert len(error.strip().splitlines()) == 1
