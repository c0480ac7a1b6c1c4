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

from calib_capture.motion import Leg, Trajectory, motion_limits
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

    def send(self, trajectory, names=None):
        self.publisher.publish(joint_trajectory(names or self.arm.joint_names, trajectory))

    def way(self, *postures, rest=0.0, start=(0.0,) * 6):
        """By some postures, as fast as may be, with a rest at each."""
        leg = Leg(np.array(start), motion_limits(self.arm, 10.0, 100.0))
        for posture in postures:
            leg.to(np.array(posture))
            leg.rest(rest)
        return leg.trajectory()

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


EXACT = {'noise': 0.0, 'step': 0.0}


def test_the_arm_follows_at_its_rate_within_its_speeds(graph, peer, arm_file, kr5):
    graph.start(MODULE, arm=arm_file, time_scale=5, rate=100, **EXACT)
    peer.ready()
    del peer.states[:]
    peer.send(peer.way(GOAL, np.zeros(6)))
    peer.spin(1.0)
    stamps, q = peer.arrays()
    assert 60 <= len(q) <= 115
    assert 4.0 <= stamps[-1] - stamps[0] <= 6.5  # five seconds for the arm
    assert np.abs(q - GOAL).max(axis=1).min() < 0.3
    assert np.abs(q[-1]).max() < 1e-9
    steps = np.abs(np.diff(q, axis=0)) / np.diff(stamps)[:, None]
    assert (steps <= kr5.velocity * (1 + 1e-4)).all()  # stamps are whole nanoseconds


def test_its_encoders_scatter_and_step_unless_told_otherwise(graph, peer, arm_file):
    graph.start(MODULE, arm=arm_file, noise=3e-6)
    peer.until(lambda: len(peer.states) >= 100)
    _, q = peer.arrays()
    assert 1e-6 < q.std(axis=0).max() < 1e-5
    steps = q / (2 * np.pi / 2**21)
    assert np.abs(steps - np.round(steps)).max() < 1e-6


def test_both_descriptions_are_there_for_whoever_comes_late(graph, peer, arm_file, kr5):
    graph.start(MODULE, arm=arm_file)
    peer.until(lambda: len(peer.texts) == 2)
    assert parse_arm(peer.texts['/arm_description']) == kr5
    assert '<robot' in peer.texts['/robot_description']


def test_an_empty_trajectory_is_rejected_and_the_old_one_goes_on(graph, peer, arm_file):
    process = graph.start(MODULE, arm=arm_file, rate=100, **EXACT)
    peer.ready()
    peer.send(peer.way(GOAL))
    peer.until(lambda: np.abs(peer.states[-1].velocity).max() > 0.01)
    peer.publisher.publish(JointTrajectory(joint_names=list(peer.arm.joint_names)))
    peer.until(lambda: np.allclose(peer.states[-1].position, GOAL))
    peer.send(peer.way(np.zeros(6), start=GOAL), names=[f'other_{i}' for i in range(6)])
    peer.spin(0.5)
    assert np.allclose(peer.states[-1].position, GOAL)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=10)
    assert process.returncode == 0
    rejected = [line for line in said.splitlines() if 'rejected' in line]
    assert 'empty trajectory' in rejected[0]
    assert 'other_0' in rejected[1]
    assert len(rejected) == 2
    assert 'Traceback' not in said


def test_a_step_of_velocity_is_a_fault_after_which_it_takes_nothing(graph, peer, arm_file):
    process = graph.start(MODULE, arm=arm_file, rate=100, **EXACT)
    peer.ready()
    peer.send(Trajectory(np.array([0.5, 2.0]), np.array([np.zeros(6), GOAL])))
    peer.spin(1.0)
    peer.send(peer.way(GOAL))
    peer.spin(1.0)
    assert np.abs(peer.states[-1].position).max() < 1e-9
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=10)
    assert 'FAULT joint_a' in said
    assert 'rad/s^2 in a jump of velocity, limit 10' in said
    assert 'rejected: the arm has failed' in said


def test_stepped_a_minute_of_motion_is_over_at_once(graph, peer, arm_file):
    graph.start(MODULE, arm=arm_file, time_scale=0, **EXACT)
    peer.ready()
    begin = time.monotonic()
    before = stamp_of(peer.states[-1].header)
    way = peer.way(GOAL, GOAL, np.zeros(6), *[GOAL, np.zeros(6)] * 20, rest=0.06)
    peer.send(way)
    peer.until(lambda: stamp_of(peer.states[-1].header) - before > way.duration * 1e9)
    assert time.monotonic() - begin < 5.0
    stamps, q = peer.arrays()
    there = np.flatnonzero(np.abs(q - GOAL).max(axis=1) < 1e-9)
    # start, middle and end of the first rests, two in a row
    assert np.allclose(np.diff(stamps[there[:5]]), 0.03)
    assert (np.diff(stamps) > 0).all()


def test_stepped_the_encoders_scatter_alike_however_long_the_arm_stood(graph, peer, arm_file):
    seen = []
    for idle in (0.0, 0.4):
        arm = graph.start(MODULE, arm=arm_file, time_scale=0, noise=2e-5, step=0.0)
        peer.ready()
        peer.spin(idle)
        del peer.states[:]
        peer.send(peer.way(GOAL, GOAL, np.zeros(6), rest=0.06))
        peer.until(lambda: len(peer.states) > 12)
        found = [each for each in peer.states if abs(each.position[0] - GOAL[0]) < 1e-3]
        seen.append([(stamp_of(each.header) % 10_000_000, *each.position) for each in found[:4]])
        arm.terminate()
        arm.communicate(timeout=20)
        del peer.states[:]
    assert len(set(seen[0])) == 4
    assert seen[0] == seen[1]


def test_stepped_a_long_trajectory_arrives_whole(graph, peer, arm_file):
    """Three hundred poses at once, with a rest at each: more states than a publisher keeps."""
    graph.start(MODULE, arm=arm_file, time_scale=0, **EXACT)
    peer.ready()
    targets = np.random.default_rng(1).uniform(-0.5, 0.5, (300, 6))
    del peer.states[:]
    peer.send(peer.way(*targets, rest=0.1))
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
