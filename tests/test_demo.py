# SPDX-License-Identifier: Apache-2.0
"""The demo as `make demo` starts it: a whole calibration, with another seed than the default."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from calib_capture.motion import (
    InterpolatedMotion,
    MotionState,
    checked_trajectory,
    motion_limits,
)
from calib_capture.nodes.messages import points_of
from calib_model.bags import read_measurement, read_messages
from calib_model.topics import JOINT_TRAJECTORY

ROOT = Path(__file__).resolve().parent.parent
AUDIT = ROOT / 'tests' / 'audit'
SEED = 4
TIMEOUT = 180
FILES = (
    'result.json',
    'arm.yaml',
    'probe.yaml',
    'arm.urdf',
    'identification',
    'held_out',
    'report.html',
    'figures/before_and_after.png',
)
pytestmark = [pytest.mark.system, pytest.mark.timeout(240)]


@pytest.fixture(scope='module')
def environment():
    """What a shell that has sourced env.bash passes on."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    return dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)


def started(environment, *arguments):
    return subprocess.Popen(
        ['python', '-m', 'calib_bringup.demo', *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture(scope='module')
def demo(environment, tmp_path_factory):
    """One finished demo: its folder, what it said, who opened which files."""
    folder, opened = tmp_path_factory.mktemp('demo') / 'out', tmp_path_factory.mktemp('opened')
    audited = {
        **environment,
        'OPENED_FILES': str(opened),
        'PYTHONPATH': f'{AUDIT}:{environment.get("PYTHONPATH", "")}',
    }
    process = started(audited, '--seed', SEED, '--output', folder)
    said, error = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, error
    assert error == ''
    result = json.loads((folder / 'result.json').read_text())
    return {
        'folder': folder,
        'said': said,
        'result': result,
        'opened': [path.read_text(errors='replace').splitlines() for path in opened.iterdir()],
    }


def columns(demo):
    """The table's figures in mm by row and column."""
    lines = demo['said'].rstrip().splitlines()[-5:]
    head = ['mm', 'initial', 'identified', 'held-out initial', 'held-out identified']
    assert lines[0].split() == ' '.join(head).split()
    return {line[:22].strip(): [float(cell) for cell in line[22:].split()] for line in lines[1:]}


def test_it_ends_with_the_table_of_its_result(demo):
    quality = demo['result']['quality']
    for row, group, key in (
        ('distance error, mean', 'distance', 'mean'),
        ('distance error, max', 'distance', 'max'),
        ('2 sigma, mean', 'two_sigma', 'mean'),
        ('2 sigma, max', 'two_sigma', 'max'),
    ):
        initial, identified, _, test = columns(demo)[row]
        expected = [quality[name][group][key] * 1e3 for name in ('initial', 'identified', 'test')]
        assert [initial, identified, test] == pytest.approx(expected, abs=6e-5)


def test_errors_fall_tenfold_where_it_identified(demo):
    quality = demo['result']['quality']
    for group in ('distance', 'two_sigma'):
        assert quality['identified'][group]['mean'] * 10 <= quality['initial'][group]['mean']
    assert demo['result']['solver']['converged']


def test_errors_fall_tenfold_where_it_did_not_and_stay_near_the_others(demo):
    _, _, initial, test = columns(demo)['distance error, mean']
    quality = demo['result']['quality']
    assert test * 10 <= initial
    assert quality['test']['distance']['mean'] <= 3 * quality['identified']['distance']['mean']


def test_every_sphere_was_taken_sixty_times(demo):
    poses = read_measurement(demo['folder'] / 'identification').poses
    taken = Counter(zip(poses.location.tolist(), poses.sphere.tolist(), strict=True))
    assert set(taken) == {(at, sphere) for at in range(1, 8) for sphere in (1, 6, 10, 14)}
    assert min(taken.values()) >= 60


def test_what_the_arm_was_sent_keeps_its_limits_at_every_millisecond(demo):
    """From rest to rest; the commands are in the bags, beside what came of them."""
    arm = read_measurement(demo['folder'] / 'identification').arm
    limits = motion_limits(arm)
    sent = 0
    for bag in ('identification', 'held_out'):
        for message in read_messages(demo['folder'] / bag, {JOINT_TRAJECTORY.name}):
            command = deserialize_message(message.data, JointTrajectory)
            asked = checked_trajectory(arm, *points_of(command))
            motion = InterpolatedMotion(MotionState.resting(asked.positions[0]), asked)
            q, v, a = motion.states_at(np.arange(0.0, motion.duration, 1e-3))
            lower, upper = limits.position.T
            assert ((q >= lower) & (q <= upper)).all()
            assert (np.abs(v) <= limits.velocity * (1 + 1e-6)).all()
            assert (np.abs(a) <= limits.acceleration * (1 + 1e-6)).all()
            assert (np.abs(np.diff(a, axis=0)) <= 1e-3 * limits.jerk * (1 + 1e-3)).all()
            assert not v[0].any() and not asked.velocities[-1].any()
            sent += 1
    assert sent > 80


def test_the_held_out_location_is_not_among_the_others(demo):
    assert set(read_measurement(demo['folder'] / 'held_out').poses.location.tolist()) == {8}


def test_all_files_are_there_and_nothing_is_left_beside_them(demo):
    for name in FILES:
        assert (demo['folder'] / name).exists(), name
    assert [path.name for path in demo['folder'].parent.iterdir()] == ['out']


def test_capture_and_solver_never_open_the_simulated_world(demo):
    """Not its configuration, not its code; that the probe does shows that this would be seen."""
    opened = {}
    for command, *paths in demo['opened']:
        for module in ('capture_node', 'arm_node', 'identify', 'evaluate', 'probe_node'):
            if f'.{module}' in command.partition('--ros-args')[0]:
                opened.setdefault(module, []).extend(paths)
    assert set(opened) == {'capture_node', 'arm_node', 'identify', 'evaluate', 'probe_node'}
    assert any(path.endswith('world.yaml') for path in opened['probe_node'])
    for module in ('capture_node', 'identify', 'evaluate', 'arm_node'):
        assert len(opened[module]) > 20
        assert [p for p in opened[module] if 'selfcenter_probe' in p or 'world' in p] == []


def test_a_folder_that_is_no_demo_s_is_left_alone(environment, tmp_path):
    (tmp_path / 'thesis.txt').write_text('three years')
    process = started(environment, '--output', tmp_path)
    said, error = process.communicate(timeout=30)
    assert process.returncode == 2
    assert error.strip() == f'demo: {tmp_path} is there and no earlier demo: not replaced'
    assert said == ''
    assert (tmp_path / 'thesis.txt').read_text() == 'three years'


def children_of(pid):
    listing = Path(f'/proc/{pid}/task/{pid}/children')
    return [int(child) for child in listing.read_text().split()]


def running(pid):
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != 'linux', reason='looks at /proc')
@pytest.mark.parametrize(
    ('number', 'code'), [(signal.SIGINT, 130), (signal.SIGTERM, 130), (signal.SIGKILL, -9)]
)
def test_however_it_ends_its_processes_end_and_an_earlier_result_stays(
    environment, tmp_path, number, code
):
    folder = tmp_path / 'out'
    for bag in ('identification', 'held_out'):
        (folder / bag).mkdir(parents=True)
    (folder / 'result.json').write_text('earlier')
    process = started(environment, '--output', folder)
    end = time.monotonic() + 60
    while len(children_of(process.pid)) < 3 and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(1.0)
    children = children_of(process.pid)
    assert len(children) == 3
    os.kill(process.pid, number)
    process.communicate(timeout=30)
    assert process.returncode == code
    end = time.monotonic() + 15
    while any(map(running, children)) and time.monotonic() < end:
        time.sleep(0.05)
    assert not any(map(running, children))
    assert (folder / 'result.json').read_text() == 'earlier'
    if number != signal.SIGKILL:
        assert [path.name for path in tmp_path.iterdir()] == ['out']
