# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, spoken to over DDS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')
pytest.importorskip('calib_interfaces.msg')

from calib_interfaces.msg import StylusDisplacements
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_bringup.domains import held_domain
from calib_model.descriptions import arm_yaml, gauge_yaml, probe_yaml
from calib_model.nodes import qos_of
from calib_model.stamps import SECOND
from calib_model.topics import (
    DESCRIPTIONS,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DESCRIPTION,
    PROBE_DISPLACEMENTS,
)
from selfcenter_probe.sensing import Status
from selfcenter_probe.simulation import Magnitudes

DOMAIN = held_domain()
T0 = 1_700_000_000
TIMEOUT = 20.0
pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]


@pytest.fixture
def files(scene, tmp_path, default_world_file):
    """The parameters of the node: the scene in files."""
    rows = [
        {
            'number': n,
            'translation': t.translation.tolist(),
            'rotation_vector': t.rotation_vector.tolist(),
        }
        for n, t in scene.placements.items()
    ]
    texts = {
        'arm': arm_yaml(scene.arm),
        'probe': probe_yaml(scene.probe),
        'gauge': gauge_yaml(scene.gauge),
        'placements': f'locations: {rows}',
    }
    for name, text in texts.items():
        (tmp_path / f'{name}.yaml').write_text(text)
    paths = {name: str(tmp_path / f'{name}.yaml') for name in texts}
    return {**paths, 'world': str(default_world_file)}


def command(parameters):
    pairs = [part for key, value in parameters.items() for part in ('-p', f'{key}:={value}')]
    return [sys.executable, '-m', 'selfcenter_probe.nodes.probe_node', '--ros-args', *pairs]


def environment():
    return {
        **os.environ,
        'ROS_DOMAIN_ID': str(DOMAIN),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


@contextmanager
def running(parameters):
    process = subprocess.Popen(
        command(parameters), env=environment(), stderr=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        # a node that is killed haunts the graph until its lease runs out
        process.send_signal(signal.SIGTERM)
        try:
            process.communicate(timeout=TIMEOUT)
        finally:
            process.kill()


class Listener(Node):
    """What a capture node would see of the probe, and an arm's joint states for it."""

    def __init__(self, context):
        super().__init__('listener', context=context)
        self.readings, self.texts = [], {}
        self.create_subscription(
            StylusDisplacements,
            PROBE_DISPLACEMENTS.name,
            self.readings.append,
            qos_of(PROBE_DISPLACEMENTS),
        )
        for topic in DESCRIPTIONS:
            self.create_subscription(
                String,
                topic.name,
                lambda message, name=topic.name: self.texts.update({name: message.data}),
                qos_of(topic),
            )
        self.states = self.create_publisher(JointState, JOINT_STATES.name, qos_of(JOINT_STATES))
        self.executor_ = SingleThreadedExecutor(context=context)
        self.executor_.add_node(self)

    def wait_for(self, done):
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, 'nothing came in time'
            self.executor_.spin_once(timeout_sec=0.05)

    def send(self, nanoseconds, names, positions):
        state = JointState(name=list(names), position=[float(q) for q in positions])
        seconds, rest = divmod(nanoseconds, SECOND)
        state.header.stamp.sec, state.header.stamp.nanosec = T0 + seconds, rest
        self.states.publish(state)

    def begin(self, names, q):
        """Wait until states reach the probe and readings come back, then forget those."""
        stamp = -1000 * SECOND
        deadline = time.monotonic() + TIMEOUT
        while not self.readings:
            assert time.monotonic() < deadline, 'no reading came back in time'
            stamp += SECOND
            self.send(stamp, names, q)
            self.executor_.spin_once(timeout_sec=0.2)
        # states still under way are read before this one, and its reading ends the beginning
        self.send(0, names, q)
        self.wait_for(lambda: self.stamps()[-1] == 0)
        self.readings.clear()

    def stamps(self):
        return [(r.header.stamp.sec - T0) * SECOND + r.header.stamp.nanosec for r in self.readings]


@pytest.fixture
def listener(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    node = Listener(context)
    yield node
    node.executor_.shutdown()
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_it_reads_the_sphere_it_is_held_to_and_nothing_elsewhere(files, listener, scene, away):
    world = scene.world(Magnitudes())
    with running(files) as process:
        names = scene.arm.joint_names
        listener.begin(names, scene.joints[0])
        listener.send(SECOND, names, scene.joints[0])
        listener.send(SECOND + 50_000_000, names, scene.joints[0])
        listener.send(2 * SECOND, names, away)
        listener.wait_for(lambda: len(listener.readings) >= 7)
        assert process.poll() is None
    expected = [*(SECOND + 10_000_000 * i for i in range(6)), 2 * SECOND]
    assert listener.stamps() == expected
    status = [list(r.status) for r in listener.readings]
    assert status == [[Status.OK] * 3] * 6 + [[Status.NO_CONTACT] * 3]
    assert {r.header.frame_id for r in listener.readings} == {scene.probe.name}
    displacement = np.array([r.displacement for r in listener.readings])
    nominal = world.contact(world.sight(scene.joints[:1]).p_probe_sphere).displacement
    # near what it should be, yet not that: the world is off by a few tenths of a millimetre
    off = np.abs(displacement[:6] - nominal)
    assert 1e-5 < off.max() < 5e-3
    assert displacement[:6].std(axis=0).max() < 5e-6


def test_what_it_tells_of_itself_is_nominal_whatever_the_truth(files, listener, scene):
    with running({**files, 'seed': 77}):
        listener.wait_for(lambda: len(listener.texts) == 2)
    assert listener.texts == {
        PROBE_DESCRIPTION.name: probe_yaml(replace(scene.probe, simulated=True)),
        GAUGE_DESCRIPTION.name: gauge_yaml(scene.gauge),
    }


def test_joints_are_found_by_name_and_states_of_another_arm_ignored(files, listener, scene):
    names, q = list(scene.arm.joint_names), scene.joints[0]
    with running(files) as process:
        listener.begin(names, q)
        listener.send(1 * SECOND, ['shoulder', 'elbow'], [0.0, 0.0])
        listener.send(2 * SECOND, names, [np.nan, *q[1:]])
        listener.send(3 * SECOND, names, q[:3])
        listener.send(4 * SECOND, [*reversed(names), 'gripper'], [*reversed(q), 0.02])
        listener.wait_for(lambda: listener.readings)
        process.send_signal(signal.SIGINT)
        complaints = process.communicate(timeout=TIMEOUT)[1]
    assert listener.stamps() == [4 * SECOND]
    assert list(listener.readings[0].status) == [Status.OK] * 3
    assert complaints.count('joint states without a1, a2, a3, a4, a5, a6 are ignored') == 1


def test_the_seed_decides_what_is_read(files, listener, scene, default_world_file, tmp_path):
    exact = tmp_path / 'exact.yaml'
    exact.write_text(default_world_file.read_text().replace('noise: full', 'noise: none'))
    read = []
    for seed in (3, 3, 4):
        with running({**files, 'world': exact, 'seed': seed}):
            listener.begin(scene.arm.joint_names, scene.joints[0])
            listener.send(SECOND, scene.arm.joint_names, scene.joints[0])
            listener.wait_for(lambda: listener.readings)
        read.append(list(listener.readings[0].displacement))
        listener.wait_for(lambda: not listener.count_publishers(PROBE_DISPLACEMENTS.name))
        listener.readings.clear()
    assert read[0] == read[1]
    assert read[0] != read[2]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('delay', [0.0, 0.001, 0.01, 0.3])
def test_it_ends_quietly_when_told_to(files, number, delay):
    with running(files) as process:
        assert 'at 2 locations' in process.stderr.readline()
        time.sleep(delay)
        process.send_signal(number)
        said = process.communicate(timeout=TIMEOUT)[1]
        assert process.returncode == 0
    assert 'Traceback' not in said


@pytest.mark.parametrize(
    ('change', 'named'),
    [
        ({'arm': '/no/such/arm.yaml'}, '/no/such/arm.yaml: cannot be read'),
        ({'gauge': 'ARM'}, "missing key 'sphere_diameter'"),
        ({'rate': 'fast'}, "parameter 'rate': expected a number"),
        ({'rate': '0.0'}, "parameter 'rate': expected a number"),
        ({'max_gap': '-1'}, "parameter 'max_gap': expected a number"),
        ({'seed': '-2'}, 'seed'),
        ({'world': 'ARM'}, ''),
    ],
)
def test_what_cannot_be_used_is_one_line_and_exit_code_2(files, change, named):
    if 'world' in change:
        (broken := os.path.join(os.path.dirname(files['arm']), 'broken.yaml'))
        with open(broken, 'w', encoding='utf-8') as stream:
            stream.write('arm: {lenght: 1.0}')
        change, named = {'world': broken}, "unknown key 'lenght': is it 'length'?"
    change = {key: files['arm'] if value == 'ARM' else value for key, value in change.items()}
    done = subprocess.run(
        command({**files, **change}),
        env=environment(),
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.returncode == 2
    assert done.stdout == ''
    assert len(done.stderr.splitlines()) == 1
    assert named in done.stderr


def test_the_health_of_the_probe_is_told_once_a_second(files, listener):
    told = []
    listener.create_subscription(DiagnosticArray, '/diagnostics', told.append, 10)
    with running(files):
        listener.wait_for(lambda: len(told) >= 2)
    (status,) = told[-1].status
    assert (status.level, status.message) == (b'\x03', 'no readings: no joint states from the arm')
    values = {value.key: value.value for value in status.values}
    assert values['readings per second'] == '0.0'
    assert values['stylus 3 signal'] == 'NO_CONTACT'
