# SPDX-License-Identifier: Apache-2.0
"""What a subscriber sees of a capture that goes on, against what the bag has in the end."""

from __future__ import annotations

import signal
import time
from collections import Counter

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from calib_interfaces.msg import CaptureQuality
from perfect_probe import PerfectProbe
from rclpy.serialization import deserialize_message
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from calib_capture.replaying import paired_program, read_playback
from calib_model.bags import read_measurement, read_messages, recover
from calib_model.nodes import qos_of
from calib_model.pairing import SteadySettings
from calib_model.topics import (
    CAPTURE_MARKERS,
    CAPTURE_QUALITY,
    JOINT_STATES,
    JOINT_TRAJECTORY,
    commanded,
)

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
ARM, CAPTURE = 'calib_capture.nodes.arm_node', 'calib_capture.nodes.capture_node'
COMMANDS = commanded('kuka')


@pytest.fixture
def perfect(domain, kr5, probe, gauge, placements, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    perfect = PerfectProbe(domain, kr5, probe, gauge, placements)
    yield perfect
    perfect.close()


def test_counts_refusals_and_commands_are_those_of_the_bag(graph, perfect, config, tmp_path):
    heard = {CaptureQuality: [], MarkerArray: [], JointTrajectory: []}
    for kind, topic in (
        (CaptureQuality, CAPTURE_QUALITY),
        (MarkerArray, CAPTURE_MARKERS),
        (JointTrajectory, COMMANDS),
    ):
        perfect.node.create_subscription(kind, topic.name, heard[kind].append, qos_of(topic))
    touched, blind = perfect.touched, []

    def not_in_two_postures(joints):
        read, status = touched(joints)
        alike = [np.abs(joints - each).max() < 2e-3 for each in blind]
        if not status.any() and not any(alike) and len(blind) < 2:
            blind.append(joints)
            alike = [True]
        return (read, np.ones(3, dtype=np.uint8)) if any(alike) else (read, status)

    perfect.touched = not_in_two_postures
    arm = config / 'arms' / 'kuka_kr5_sixx_r650.yaml'
    graph.start(ARM, arm=arm, time_scale=0, noise=0.0, step=0.0, controller='kuka')
    capture = graph.start(
        CAPTURE,
        controller='kuka',
        placements=config / 'locations' / 'kr5.yaml',
        output=tmp_path / 'bag',
        locations='[3]',
        spheres='[2, 11]',
        poses_per_sphere=14,
        pool=1,
    )
    perfect.spin_while(capture)
    said, error = capture.communicate()
    assert capture.returncode == 0, error

    poses = read_measurement(tmp_path / 'bag').poses
    qualities = heard[CaptureQuality]
    for each in qualities:
        assert each.taken + each.refused + each.left >= each.planned == 28
        assert each.taken == sum(one.taken for one in each.spheres)
        assert each.refused == sum(each.refused_by_reason)
        assert np.isfinite(each.seconds_left)
    last = qualities[-1]
    in_bag = Counter(zip(poses.location.tolist(), poses.sphere.tolist(), strict=True))
    assert {(one.location, one.sphere): one.taken for one in last.spheres} == in_bag
    assert (last.taken, last.left, last.seconds_left) == (len(poses), 0, 0.0)
    assert last.refused == len(blind) == 2
    assert last.reasons == ['no contact']
    assert last.two_sigma < 1e-6
    assert last.two_sigma_identified < 1e-6  # 28 poses of two spheres are enough
    told = [line for line in said.splitlines() if 'is refused' in line]
    assert len(told) == 1
    assert told[0].startswith('location 3, sphere ')
    assert 'no contact' in told[0]

    needles = {marker.ns: len(marker.points) // 2 for marker in heard[MarkerArray][-1].markers}
    assert (needles['taken'], needles['refused']) == (len(poses), 2)

    recorded = [
        deserialize_message(message.data, JointTrajectory)
        for message in read_messages(tmp_path / 'bag', {COMMANDS.name})
    ]
    assert recorded
    assert [each for each in heard[JointTrajectory] if each not in recorded] == []
    # and disturb nobody who reads the bag
    with AnyReader([tmp_path / 'bag']) as reader:
        theirs = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.topic == COMMANDS.name
        ]
    assert [len(each.points) for each in theirs] == [len(each.points) for each in recorded]
    assert theirs[-1].points[-1].positions.tolist() == recorded[-1].points[-1].positions.tolist()
    assert recover(tmp_path / 'bag', tmp_path / 'again').messages
    again = paired_program(tmp_path / 'again', SteadySettings(settle=0.01, dwell=0.03))
    assert len(again.measured.poses) == len(poses)
    playback = read_playback(tmp_path / 'bag')
    assert playback.commands == (COMMANDS.name,)
    assert COMMANDS.name not in {each.topic for each in (*playback.latched, *playback.timed())}


def test_the_command_that_stops_the_arm_and_its_way_to_rest_are_in_the_bag(
    graph, perfect, config, tmp_path
):
    heard = []
    perfect.node.create_subscription(
        JointTrajectory, JOINT_TRAJECTORY.name, heard.append, qos_of(JOINT_TRAJECTORY)
    )
    arm = config / 'arms' / 'kuka_kr5_sixx_r650.yaml'
    graph.start(ARM, arm=arm, noise=0.0, step=0.0)
    capture = graph.start(
        CAPTURE,
        placements=config / 'locations' / 'kr5.yaml',
        output=tmp_path / 'bag',
        locations='[3]',
        spheres='[2]',
        poses_per_sphere=9,
        pool=1,
    )
    here, end = None, time.monotonic() + 60
    while here is None or np.abs(perfect.before[1] - here).max() < 0.05:  # until it is on its way
        perfect.executor.spin_once(timeout_sec=0.05)
        assert time.monotonic() < end
        if heard and here is None:
            here = perfect.before[1]
    capture.send_signal(signal.SIGINT)
    perfect.spin_while(capture)
    assert capture.returncode == 130
    told = {}
    for message in read_messages(tmp_path / 'bag', {JOINT_TRAJECTORY.name, JOINT_STATES.name}):
        kind = JointState if message.topic == JOINT_STATES.name else JointTrajectory
        told.setdefault(kind, []).append(deserialize_message(message.data, kind))
    assert len(told[JointTrajectory]) == len(heard) == 2
    assert told[JointTrajectory][-1] == heard[-1]
    last = told[JointState][-1]
    assert last.position.tolist() == pytest.approx(
        heard[-1].points[-1].positions.tolist(), abs=1e-3
    )
    assert np.abs(last.velocity).max() < 1e-2
