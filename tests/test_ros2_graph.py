# SPDX-License-Identifier: Apache-2.0
"""The suite as somebody uses it with `ros2`: the stand-in, and the real one where there is one."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from rclpy.utilities import get_rmw_implementation_identifier

from calib_model.bags import read_measurement

ROOT = Path(__file__).resolve().parent.parent
STAND_IN = ROOT / 'tools' / 'ros2' / 'ros2'
CAPTURE = 'calib_interfaces/action/Capture'
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


def real_ros2() -> str | None:
    """A `ros2` on the path that is not the stand-in."""
    found = shutil.which('ros2')
    return found if found and Path(found).resolve() != STAND_IN.resolve() else None


@pytest.fixture(params=['stand-in', 'real'])
def ros2(request) -> str:
    if request.param == 'stand-in':
        return str(STAND_IN)
    return real_ros2() or pytest.skip('no real ros2 on the path')


@pytest.fixture
def start(ros2, domain, tmp_path):
    """`ros2 WORDS` in a process group of its own, its output in a file; interrupted at the end."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    environment = dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)
    environment |= {
        'ROS_DOMAIN_ID': str(domain),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'RMW_IMPLEMENTATION': get_rmw_implementation_identifier(),
    }
    running = []

    def begin(name, *words):
        log = tmp_path / f'{name}.log'
        with log.open('w') as stream:
            running.append(
                subprocess.Popen(
                    [ros2, *words],
                    env=environment,
                    stdin=subprocess.DEVNULL,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
            )
        return running[-1], log

    yield begin
    for process in running:
        interrupt(process)
    for process in running:
        process.wait(15)


def interrupt(process) -> None:
    """Ctrl-C in the process's terminal."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)


def until(log: Path, text: str, seconds: float = 40.0) -> str:
    end = time.monotonic() + seconds
    while text not in (said := log.read_text()):
        assert time.monotonic() < end, f'{text!r} is not in: {said[-2000:]}'
        time.sleep(0.05)
    return said


def test_a_goal_interrupted_by_ctrl_c_is_cancelled_and_leaves_a_bag_that_opens(start, tmp_path):
    start('arm', 'run', 'calib_capture', 'arm', '--ros-args', '-p', 'time_scale:=3.0')
    start('probe', 'run', 'selfcenter_probe', 'probe')
    capture, log = start(
        'capture',
        'run',
        'calib_capture',
        'capture',
        '--ros-args',
        '-p',
        'serve:=true',
        '-p',
        'pool:=1',
    )
    until(log, 'waiting for goals')
    bag = tmp_path / 'bag'
    client, said = start(
        'client',
        'action',
        'send_goal',
        '--feedback',
        '/capture/run',
        CAPTURE,
        f'{{locations: [1], spheres: [1], poses_per_sphere: 100, bag: {bag}}}',
    )
    until(said, 'taken: 3')
    interrupt(client)
    client.wait(20)
    assert 'Canceling goal' in said.read_text()
    told = until(log, 'stopped: ')
    assert capture.poll() is None
    taken = int(told.split('stopped: ')[1].split(' poses taken')[0].split()[-1])
    assert len(read_measurement(bag).poses) == taken >= 3


@pytest.mark.skipif(real_ros2() is None, reason='no real ros2 on the path')
@pytest.mark.parametrize('name', ['demo', 'capture', 'solver', 'replay'])
def test_the_real_launch_shows_the_arguments(name) -> None:
    shown = subprocess.run(
        [str(real_ros2()), 'launch', 'calib_bringup', f'{name}.launch.py', '--show-args'],
        capture_output=True,
        text=True,
        timeout=30,
    )
    assert shown.returncode == 0, shown.stderr
    assert shown.stdout.startswith('Arguments')


@pytest.mark.skipif(real_ros2() is None, reason='no real ros2 on the path')
def test_the_real_ros2_runs_and_calls(start) -> None:
    bag = ROOT / 'bags' / 'demo' / 'identification'
    _, log = start('solver', 'run', 'calib_solver', 'solver')
    until(log, 'ready')
    _, said = start(
        'call', 'service', 'call', '/identify', 'calib_interfaces/srv/Identify', f'{{bag: {bag}}}'
    )
    assert 'success=True' in until(said, 'Identify_Response')
