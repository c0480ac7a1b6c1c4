# SPDX-License-Identifier: Apache-2.0
"""Streams as fast as hardware sends them, and calls without end: nothing lost, memory flat.

Some seconds of it here; `SOAK=1` makes it 10 minutes, 10,000 calls and 500 identifications, and
writes what was seen to docs/soak.md.
"""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.srv', reason='the workspace is not built')
from calib_interfaces.srv import Evaluate, Identify
from rclpy.executors import SingleThreadedExecutor
from soak import SOAK, note

from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment
from calib_capture.replaying import read_recording
from calib_model.bags import read_measurement

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'ros2_ws/src/calib_bringup/config'
DEMO = ROOT / 'bags/demo/identification'
SECONDS, WARM = (600.0, 60.0) if SOAK else (8.0, 3.0)
EVALUATIONS, IDENTIFICATIONS = (10_000, 500) if SOAK else (60, 6)
FLAT = 1.05  # of the memory after the first minute
JOINTS, READINGS = 500, 1000  # Hz of the wall clock
SAID = re.compile(r'(\d+) poses of (\d+) spheres taken from (\d+) readings')
LOST = re.compile(r'(\d+) of (\S+) lost')
SENT = re.compile(r'(\d+) joint states, (\d+) readings')
pytestmark = [pytest.mark.system, pytest.mark.timeout(5400 if SOAK else 120)]


@pytest.fixture
def start(tmp_path):
    env = graph_environment(held_domain())
    with Children() as children:

        def begin(name: str, module: str, **parameters: object) -> Child:
            given = ['--ros-args']
            for key, value in parameters.items():
                given += ['-p', f'{key}:={value}']
            return children.start(Child(name, module, given, env, tmp_path / f'{name}.log'))

        begin.domain = int(env['ROS_DOMAIN_ID'])
        yield begin


def resident(child: Child) -> float:
    """Memory that a process holds, MiB."""
    pages = int(Path(f'/proc/{child.process.pid}/statm').read_text().split()[1])
    return pages * os.sysconf('SC_PAGE_SIZE') / 2**20


def until(child: Child, done, seconds: float) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert child.process.poll() is None, child.complaint()
        assert time.monotonic() < end, f'{child.name} takes too long'
        time.sleep(0.05)


def test_a_led_arm_at_1_khz_is_recorded_to_the_last_reading_in_flat_memory(start, tmp_path):
    """At twice real time: 500 joint states and 1000 readings in every second of the wall clock."""
    operator = start(
        'operator',
        'selfcenter_probe.nodes.operator_node',
        probe='active',
        poses=2500,
        time_scale=2.0,
        wait=30.0,
    )
    bag = tmp_path / 'bag'
    capture = start(
        'capture',
        'calib_capture.nodes.capture_node',
        mode='continuous',
        output=bag,
        spacing=0.5,
        silence=20.0,
        placements=CONFIG / 'locations/faro.yaml',
    )
    until(capture, (bag / 'bag_0.mcap').exists, 90)
    begin = time.monotonic()
    time.sleep(WARM)
    early = resident(capture)
    time.sleep(begin + SECONDS - time.monotonic())
    assert capture.process.poll() is None, capture.complaint()
    late = resident(capture)
    capture.process.send_signal(signal.SIGINT)
    assert capture.process.wait(120) == 0, capture.complaint()
    assert operator.process.poll() is None, operator.complaint()
    text = (tmp_path / 'capture.log').read_text()
    found = SAID.search(text)
    assert found is not None, text
    taken, _, readings = (int(number) for number in found.groups())
    lost = {topic: int(count) for count, topic in LOST.findall(text)}
    streams = read_recording(bag).streams
    states, came = streams.joint_stamp, streams.reading_stamp
    # every gap within a seating is of messages that the capture says it lost
    gaps = {
        '/joint_states': missed(states, 4_000_000),
        '/probe/displacements': missed(came, 2_000_000),
    }
    rate = (len(states) / (np.ptp(states) / 1e9) * 2, len(came) / (np.ptp(came) / 1e9) * 2)
    wall = len(came) / SECONDS
    print(text.splitlines()[-1], early, late, gaps, lost, rate, wall)
    unreported = {topic: max(0, count - lost.get(topic, 0)) for topic, count in gaps.items()}
    assert not any(unreported.values()), (gaps, lost)
    assert readings == len(came)
    assert len(read_measurement(bag).poses) == taken
    assert late < FLAT * early + (0 if SOAK else 5)
    if wall <= 0.5 * READINGS:
        pytest.skip(f'the machine is too busy to send more than {wall:.0f} readings a second')
    note(
        led_seconds=SECONDS,
        led_joint_states=len(states),
        led_readings=len(came),
        led_readings_per_second=wall,
        led_lost_reported=sum(lost.values()),
        led_lost_unreported=sum(unreported.values()),
        led_poses=taken,
        led_memory=[early, late],
        led_bag_mb=(bag / 'bag_0.mcap').stat().st_size / 1e6,
    )


def missed(stamps: np.ndarray, period: int) -> int:
    """Messages that are missing between stamps (ns) that come in each `period`; seatings, between
    which the hand is away, are apart by much more."""
    steps = np.diff(stamps)
    short = steps[steps < 50 * period]
    return int((np.round(short / period) - 1).sum())


@pytest.fixture
def solver(start):
    child = start('solver', 'calib_solver.nodes.solver_node', bag_folders=f'[{DEMO.parent}]')
    context = rclpy.Context()
    before = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(context=context, domain_id=start.domain)
    asker = rclpy.create_node('asker', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(asker)
    clients = {
        Evaluate: asker.create_client(Evaluate, 'evaluate'),
        Identify: asker.create_client(Identify, 'identify'),
    }

    def ask(kind, **request):
        assert clients[kind].wait_for_service(timeout_sec=30), 'no solver'
        future = clients[kind].call_async(kind.Request(**request))
        # rclpy's own loop leaves a task behind for each turn, and 10,000 calls drown in them
        end = time.monotonic() + 60
        while not future.done():
            assert time.monotonic() < end, 'no answer'
            executor.spin_once(timeout_sec=1)
        assert future.result().success, future.result().message
        return future.result()

    ask.process = child
    yield ask
    executor.shutdown()
    asker.destroy_node()
    rclpy.shutdown(context=context)
    if before is None:
        del os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']
    else:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = before


@pytest.mark.parametrize(
    ('kind', 'calls'),
    [(Evaluate, EVALUATIONS), (Identify, IDENTIFICATIONS)],
    ids=['evaluate', 'identify'],
)
def test_calls_in_a_row_are_all_answered_alike_in_flat_memory(solver, kind, calls):
    warm = max(2, calls // 10)
    answers: set[float] = set()
    begin, early = time.monotonic(), 0.0
    for number in range(calls):
        answer = solver(kind, bag=str(DEMO))
        quality = answer.quality if kind is Evaluate else answer.identified
        answers.add(quality.phi)
        if number == warm:
            early = resident(solver.process)
    late = resident(solver.process)
    print(calls, early, late, time.monotonic() - begin)
    assert len(answers) == 1
    assert late < FLAT * early + (0 if SOAK else 5)
    name = kind.__name__.lower()
    note(
        **{
            f'{name}_calls': calls,
            f'{name}_answered': calls,
            f'{name}_memory': [early, late],
            f'{name}_seconds': time.monotonic() - begin,
        }
    )
