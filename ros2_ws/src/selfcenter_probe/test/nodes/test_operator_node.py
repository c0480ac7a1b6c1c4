# SPDX-License-Identifier: Apache-2.0
"""The operator in a process of its own, listened to over DDS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')
pytest.importorskip('calib_interfaces.msg')

from calib_interfaces.msg import StylusDisplacements
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_bringup.domains import held_domain
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe
from calib_model.nodes import (
    qos_of,
    stamp_of,
)
from calib_model.topics import DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS
from selfcenter_probe.operator import TICK

DOMAIN = held_domain()
TIMEOUT = 30.0
ENVIRONMENT = {
    **os.environ,
    'ROS_DOMAIN_ID': str(DOMAIN),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
}
pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]


def started(*parameters):
    given = [word for parameter in parameters for word in ('-p', parameter)]
    line = [sys.executable, '-m', 'selfcenter_probe.nodes.operator_node', '--ros-args', *given]
    return subprocess.Popen(line, env=ENVIRONMENT, stderr=subprocess.PIPE, text=True)


@pytest.fixture
def listener(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = rclpy.create_node('listener', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    node.heard = {topic.name: [] for topic in (*DESCRIPTIONS, JOINT_STATES, PROBE_DISPLACEMENTS)}
    for topic, kind in (
        *((topic, String) for topic in DESCRIPTIONS),
        (JOINT_STATES, JointState),
        (PROBE_DISPLACEMENTS, StylusDisplacements),
    ):
        node.create_subscription(kind, topic.name, node.heard[topic.name].append, qos_of(topic))
    node.executor_of_test = executor
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_both_streams_come_at_their_rates_with_the_descriptions(listener):
    process = started('locations:=[1]', 'spheres:=[6]', 'probe:=active', 'poses:=60')
    heard = listener.heard
    try:
        deadline = time.monotonic() + TIMEOUT
        while len(heard[PROBE_DISPLACEMENTS.name]) < 1500 and time.monotonic() < deadline:
            listener.executor_of_test.spin_once(0.1)
    finally:
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=20)
    assert process.returncode == 0, said
    readings = heard[PROBE_DISPLACEMENTS.name]
    assert len(readings) >= 1500, said
    states = np.array([stamp_of(state.header) for state in heard[JOINT_STATES.name]])
    assert np.median(np.diff(states)) == TICK
    read = np.array([stamp_of(reading.header) for reading in readings])
    assert np.median(np.diff(read)) == TICK // 2
    assert abs(states[0] / 1e9 - time.time()) < 120  # the wall clock's, not the simulation's
    assert len(heard[JOINT_STATES.name][0].position) == 6
    assert {tuple(reading.status) for reading in readings} >= {(0, 0, 0)}
    for topic, parse in zip(DESCRIPTIONS, (parse_arm, parse_probe, parse_gauge), strict=True):
        parse(heard[topic.name][0].data, topic.name)


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ('locations:=[9]', "parameter 'locations'"),
        ('spheres:=[]', "parameter 'spheres'"),
        ('time_scale:=0', "parameter 'time_scale'"),
        ('probe:=nowhere.yaml', 'nowhere.yaml: cannot be read'),
    ],
)
def test_a_parameter_that_makes_no_sense_is_one_line_and_exit_code_2(given, said):
    process = started(given)
    _, printed = process.communicate(timeout=30)
    assert process.returncode == 2
    assert said in printed
    assert 'Traceback' not in printed
