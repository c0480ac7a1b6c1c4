# SPDX-License-Identifier: Apache-2.0
"""A hand-guided arm, live: operator and capture as processes, every reading accounted for."""

from __future__ import annotations

import re
import signal
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment
from calib_capture.commands.pair import pair_hand_guided_bag
from calib_capture.recording import CLOCK_NOTE, HandGuidedRecord
from calib_capture.replaying import read_recording
from calib_model.bags import (
    read_measurement,
    read_note,
)
from calib_model.pairing import HAND_GUIDED_NOTE

CONFIG = Path(__file__).resolve().parents[1] / 'ros2_ws/src/calib_bringup/config'
SAID = re.compile(r'(\d+) poses of (\d+) spheres taken from (\d+) readings, (\d+) paired')
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


@pytest.fixture
def graph(tmp_path):
    env = graph_environment(held_domain())
    with Children() as children:

        def start(name: str, module: str, **parameters: object) -> Child:
            given = ['--ros-args']
            for key, value in parameters.items():
                given += ['-p', f'{key}:={value}']
            return children.start(Child(name, module, given, env, tmp_path / f'{name}.log'))

        yield start


def captured(graph, tmp_path, name, seconds, **asked):
    """What a capture says that is ended by Ctrl-C after so many seconds of streams."""
    capture = graph(
        name,
        'calib_capture.nodes.capture_node',
        mode='continuous',
        output=tmp_path / 'bag',
        placements=CONFIG / 'locations/faro.yaml',
        **asked,
    )
    file = tmp_path / 'bag' / f'bag_{0 if name == "first" else 1}.mcap'
    end = time.monotonic() + 60
    while not file.exists():
        assert capture.process.poll() is None, capture.complaint()
        assert time.monotonic() < end, 'no bag is begun'
        time.sleep(0.05)
    time.sleep(seconds)
    capture.process.send_signal(signal.SIGINT)
    assert capture.process.wait(30) == 0, capture.complaint()
    text = (tmp_path / f'{name}.log').read_text(encoding='utf-8')
    found = SAID.search(text)
    assert found is not None, text
    return tuple(int(number) for number in found.groups()), text


def test_a_led_arm_is_paired_live_as_it_is_from_the_bag_and_gone_on_with(graph, tmp_path):
    graph(
        'operator',
        'selfcenter_probe.nodes.operator_node',
        locations='[3]',
        spheres='[6]',
        probe='active',
        wait=30.0,
    )
    (taken, spheres, readings, paired), text = captured(graph, tmp_path, 'first', 4.0)
    raw = read_recording(tmp_path / 'bag').streams
    came, states = raw.reading_stamp, raw.joint_stamp
    assert (np.diff(came) == 2_000_000).all()  # as they were published: none is lost
    assert (np.diff(states) == 4_000_000).all()
    assert readings == len(came) >= 1000
    assert readings - paired <= 4  # the last ones, whose joints had not come
    assert (taken, spheres) == (len(read_measurement(tmp_path / 'bag').poses), 1)
    assert taken >= 10
    assert 'clock offset: ' in text
    assert read_note(tmp_path / 'bag', CLOCK_NOTE)['shift'] == '0'

    (more, *_), text = captured(graph, tmp_path, 'second', 1.5, resume='true')
    assert f'{taken} poses are there already' in text
    poses = read_measurement(tmp_path / 'bag').poses
    assert len(poses) == taken + more > taken
    note = HandGuidedRecord.read(read_note(tmp_path / 'bag', HAND_GUIDED_NOTE), 'bag')
    pair_hand_guided_bag(tmp_path / 'bag', tmp_path / 'again', note)
    again = read_measurement(tmp_path / 'again').poses
    for column in ('stamp', 'location', 'sphere', 'joints', 'displacement'):
        assert np.array_equal(getattr(again, column), getattr(poses, column)), column
