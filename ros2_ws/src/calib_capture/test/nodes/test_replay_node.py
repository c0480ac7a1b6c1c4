# SPDX-License-Identifier: Apache-2.0
"""A bag played back by its command, heard by a node in another process."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calib_bringup.domains import held_domain
from calib_model.bags import BagWriter, cdr
from calib_model.topics import ARM_DESCRIPTION, CAPTURE_POSES, PROBE_DISPLACEMENTS, Topic

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
interfaces = pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

pytestmark = pytest.mark.system

DOMAIN = held_domain()
START = 1_700_000_000_000_000_000
ENVIRONMENT = {
    **os.environ,
    'ROS_DOMAIN_ID': str(DOMAIN),
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
}
COUNT = 40


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Half a second: a description, poses and readings each of their own topic and QoS."""
    path = tmp_path / 'bag'
    with BagWriter(path, chunk_size=1024) as writer:
        for i in range(COUNT):
            stamp = START + i * 12_500_000
            pose = cdr.probing_pose(stamp, 'base', 1, i, np.full(6, 0.1 * i), np.zeros(3), 1)
            writer.write_message(CAPTURE_POSES, pose, stamp)
            reading = cdr.displacements(stamp, 'probe', np.full(3, i * 1e-5), np.zeros(3))
            writer.write_message(PROBE_DISPLACEMENTS, reading, stamp)
        writer.write_message(ARM_DESCRIPTION, cdr.string('name: arm'), stamp)
        writer.write_message(Topic('/other', 'std_msgs/msg/String'), cdr.string('x'), stamp)
    return path


class Listener:
    """Everything heard, with the time it was heard at."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=DOMAIN)
        self.node = rclpy.create_node('listener', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list[object]] = {}
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._listen(String, '/arm_description', latched)
        self._listen(interfaces.ProbingPose, '/capture/poses', 100)
        readings = interfaces.StylusDisplacements
        best_effort = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._listen(readings, '/probe/displacements', best_effort)
        self._listen(Clock, '/clock', 100)

    def _listen(self, kind: type, topic: str, qos: object) -> None:
        heard = self.heard.setdefault(topic, [])
        self.node.create_subscription(kind, topic, heard.append, qos)

    def until_ended(self, process: subprocess.Popen[str], longest: float = 20.0) -> None:
        end = time.monotonic() + longest
        while process.poll() is None and time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)
        for _ in range(200):
            self.executor.spin_once(timeout_sec=0.002)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def listener(monkeypatch: pytest.MonkeyPatch) -> Iterator[Listener]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    listening = Listener()
    yield listening
    listening.close()


@pytest.fixture
def replaying() -> Iterator[list[subprocess.Popen[str]]]:
    """Processes that a test started; whatever happens they end with it."""
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def replay(started: list[subprocess.Popen[str]], *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, '-m', 'calib_capture.nodes.replay_node', *map(str, arguments)]
    process = subprocess.Popen(
        command, env=ENVIRONMENT, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    started.append(process)
    return process


@pytest.mark.timeout(60)
def test_everything_comes_back_in_order_with_its_qos(
    bag: Path, listener: Listener, replaying: list[subprocess.Popen[str]]
) -> None:
    process = replay(replaying, bag, '--clock')
    listener.until_ended(process)
    assert process.returncode == 0
    assert [m.data for m in listener.heard['/arm_description']] == ['name: arm']
    poses = listener.heard['/capture/poses']
    assert [pose.sphere for pose in poses] == list(range(COUNT))
    assert [pose.joint_position[5] for pose in poses] == [0.1 * i for i in range(COUNT)]
    readings = listener.heard['/probe/displacements']
    assert [reading.displacement[0] for reading in readings] == [i * 1e-5 for i in range(COUNT)]
    clock = [m.clock.sec * 10**9 + m.clock.nanosec for m in listener.heard['/clock']]
    assert clock == sorted(clock)
    assert len(clock) > 20
    assert 0 <= clock[0] - START < 10**9


@pytest.mark.timeout(60)
def test_a_cut_bag_is_played_as_far_as_it_goes(
    bag: Path, listener: Listener, replaying: list[subprocess.Popen[str]], tmp_path: Path
) -> None:
    whole = (bag / 'bag_0.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: len(whole) // 3])
    process = replay(replaying, cut, '--rate', 4)
    listener.until_ended(process)
    assert process.returncode == 0
    spheres = [pose.sphere for pose in listener.heard['/capture/poses']]
    assert 0 < len(spheres) < COUNT
    assert spheres == list(range(len(spheres)))


@pytest.mark.timeout(60)
def test_ctrl_c_ends_a_loop_cleanly(
    bag: Path, listener: Listener, replaying: list[subprocess.Popen[str]]
) -> None:
    process = replay(replaying, bag, '--loop', '--rate', 10)
    end = time.monotonic() + 20
    while len(listener.heard['/capture/poses']) < 3 * COUNT and time.monotonic() < end:
        listener.executor.spin_once(timeout_sec=0.02)
    assert len(listener.heard['/capture/poses']) >= 3 * COUNT
    process.send_signal(signal.SIGINT)
    printed, _ = process.communicate(timeout=10)
    assert process.returncode == 130
    assert 'Traceback' not in printed


@pytest.mark.timeout(60)
def test_a_type_that_is_not_installed_is_left_out_with_one_line(
    tmp_path: Path, listener: Listener, replaying: list[subprocess.Popen[str]]
) -> None:
    strange = with_type(tmp_path, 'os/msg/Path')
    process = replay(replaying, strange)
    listener.until_ended(process)
    assert process.returncode == 0
    assert len(listener.heard['/capture/poses']) == 1
    printed = process.stdout.read() if process.stdout else ''
    assert printed.count('/strange is left out: os/msg/Path is not installed') == 1


def with_type(tmp_path: Path, kind: str) -> Path:
    """A bag with one pose and one message of a type called `kind`, made without BagWriter."""
    from mcap.writer import Writer

    file = tmp_path / 'strange.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='ros2')
        pose = cdr.probing_pose(START, 'base', 1, 6, np.zeros(6), np.zeros(3), 1)
        text = cdr.schema_text(CAPTURE_POSES.type)
        for topic, name, data in (
            ('/strange', kind, b'\x00\x01\x00\x00'),
            ('/capture/poses', CAPTURE_POSES.type, cdr.encode(pose)),
        ):
            schema = writer.register_schema(name, 'ros2msg', text)
            channel = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channel, START, data, START)
        writer.finish()
    return file


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['none'], 'none: no such bag'),
        ([], 'the following arguments are required: BAG'),
        (['none', '--rate', '0'], "--rate: expected a number from 0.001 to 1e+09, got '0'"),
        (['none', '--rate', 'nan'], "--rate: expected a number from 0.001 to 1e+09, got 'nan'"),
        (['none', '--rate', 'x'], "--rate: expected a number from 0.001 to 1e+09, got 'x'"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, replaying: list[subprocess.Popen[str]]
) -> None:
    process = replay(replaying, *arguments)
    printed, _ = process.communicate(timeout=30)
    assert process.returncode == 2
    assert printed.count('\n') == 1
    assert message in printed
