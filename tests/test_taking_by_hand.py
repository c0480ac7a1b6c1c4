# SPDX-License-Identifier: Apache-2.0
"""An arm led by hand with a ball in a socket: poses are taken by service or key, live."""

from __future__ import annotations

import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from calib_interfaces.msg import CaptureQuality, ProbingPose
from posed_arm import PosedArm, posed
from seated_recordings import project
from std_srvs.srv import Trigger

from calib_bringup.processes import graph_environment
from calib_model.descriptions import parse_arm, parse_gauge, parse_probe, read_description
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_POSES, CAPTURE_QUALITY, CAPTURE_UNDONE
from calib_solver.commands.identify import main as identify

CONFIG = Path(__file__).resolve().parents[1] / 'ros2_ws/src/calib_bringup/config'
FILES = {
    'arm': CONFIG / 'arms/kuka_lbr_iiwa14.yaml',
    'probe': CONFIG / 'probes/seated_ball_iiwa14.yaml',
    'gauge': CONFIG / 'gauges/two_sockets.yaml',
}
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


class Arm(PosedArm):
    """Held in postures by a hand that calls the capture's services."""

    def __init__(self, context: rclpy.Context, names: list[str]) -> None:
        super().__init__(context, names)
        self.poses: list[ProbingPose] = []
        self.undone: list[ProbingPose] = []
        for topic, heard in ((CAPTURE_POSES, self.poses), (CAPTURE_UNDONE, self.undone)):
            self.node.create_subscription(ProbingPose, topic.name, heard.append, qos_of(topic))
        self.quality: list[CaptureQuality] = []
        self.node.create_subscription(
            CaptureQuality, CAPTURE_QUALITY.name, self.quality.append, qos_of(CAPTURE_QUALITY)
        )
        self.clients = {
            name: self.node.create_client(Trigger, f'/capture/{name}') for name in ('take', 'undo')
        }

    def hold(self, joints: np.ndarray) -> None:
        self.joints = joints
        self.spin(0.35)

    def ask(self, name: str) -> Trigger.Response:
        self.until(self.clients[name].service_is_ready)
        future = self.clients[name].call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def asked_until(self, name: str, word: str) -> Trigger.Response:
        """The answer once there is this word in it: on a busy machine states come late."""
        for _ in range(40):
            answer = self.ask(name)
            if word in answer.message:
                return answer
            self.hold(self.joints)
        raise AssertionError(answer.message)


@pytest.fixture
def arm(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[Arm, int]]:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with posed(Arm, list(read_description(FILES['arm'], parse_arm).joint_names)) as made:
        yield made


@pytest.fixture
def capture(tmp_path: Path, arm: tuple[Arm, int]) -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """The capture node on a terminal of its own, and the end of it that a hand types on."""
    hand, terminal = pty.openpty()

    def on_terminal() -> None:
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)

    words = ['mode:=continuous', f'output:={tmp_path / "bag"}']
    words += [f'{name}:={path}' for name, path in FILES.items()]
    with (tmp_path / 'log').open('w') as log:
        process = subprocess.Popen(
            [sys.executable, '-m', 'calib_capture.nodes.capture_node', '--ros-args']
            + [part for word in words for part in ('-p', word)],
            stdin=terminal,
            stdout=log,
            stderr=log,
            env=graph_environment(arm[1]),
            cwd=tmp_path,
            start_new_session=True,
            preexec_fn=on_terminal,
        )
    os.close(terminal)
    yield process, hand
    if process.poll() is None:
        process.kill()
        process.wait()
    os.close(hand)


def test_poses_are_taken_by_service_and_key_and_identified_from(
    arm: tuple[Arm, int],
    capture: tuple[subprocess.Popen[bytes], int],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    led, (process, hand) = arm[0], capture
    described = read_description(FILES['arm'], parse_arm)
    gauge = read_description(FILES['gauge'], parse_gauge)
    probe = read_description(FILES['probe'], parse_probe)
    ball = probe.flange_T_probe.apply(np.array([0.004, -0.006, 0.01]))
    draw = np.random.default_rng(6)
    start = np.array([0.1, 0.6, 0.0, -1.2, 0.0, 1.0, 0.0])
    postures = np.concatenate(
        [
            project(
                described,
                ball,
                start + draw.normal(0.0, 0.3, (8, described.n)),
                np.add((0.5, -0.1, 0.2), gauge.center(number)),
            )
            for number in gauge.numbers
        ]
    )
    for name in ('take', 'undo'):  # nothing has come of the arm, nothing is begun
        answer = led.ask(name)
        assert not answer.success
        assert 'no hand-guided session' in answer.message
    led.hold(postures[0])
    assert led.asked_until('take', 'pose 1 taken').success
    led.hold(start)  # a wrong one, in the air
    assert led.asked_until('take', 'pose 2 taken').success
    assert led.ask('undo').message == 'pose 2 taken back, 1 left'
    for number, joints in enumerate(postures[1:-1], start=2):
        led.hold(joints)
        assert led.asked_until('take', f'pose {number} taken').success
    assert 'one of 2 so far' in (tmp_path / 'log').read_text()
    led.hold(postures[-1])
    os.write(hand, b'\n')
    led.until(lambda: len(led.poses) == len(postures) + 1)
    led.hold(postures[-1])
    os.write(hand, b'\n')
    led.until(lambda: len(led.poses) == len(postures) + 2)
    os.write(hand, b'u\n')
    led.until(lambda: len(led.undone) == 2)
    led.until(lambda: led.quality[-1].taken == 16)
    process.send_signal(signal.SIGINT)
    assert process.wait(30) == 0, (tmp_path / 'log').read_text()
    assert '16 poses taken by hand, 2 taken back' in (tmp_path / 'log').read_text()
    capsys.readouterr()
    assert identify([str(tmp_path / 'bag'), '--quick']) == 0
    said = capsys.readouterr().out
    assert '16 poses taken by hand' in said
    assert '16 poses of 2 spheres at 1 locations' in said
