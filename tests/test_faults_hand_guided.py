# SPDX-License-Identifier: Apache-2.0
"""The graph misbehaves while an arm is led by hand: operator and capture as processes."""

from __future__ import annotations

import re
import signal
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
import process_graph
from calib_interfaces.msg import StylusDisplacements
from process_graph import CAPTURE, CONFIG, OPERATOR
from sensor_msgs.msg import JointState

from calib_bringup.processes import Child
from calib_capture.commands.pair import pair_hand_guided_bag
from calib_capture.recording import HandGuidedRecord
from calib_capture.replaying import read_recording
from calib_model.bags import (
    read_measurement,
    read_note,
)
from calib_model.nodes import stamp_of
from calib_model.pairing import HAND_GUIDED_NOTE

WITHIN_ONE_STATE = 1e-3  # rad that a joint of a hand-guided arm goes, at its fastest, and more
TAKEN = re.compile(r'(\d+) poses of 1 spheres taken from (\d+) readings')
LATE = re.compile(r'(\d+) joint states out of order')
BRIDGED = re.compile(r'(\d+) readings paired across missing joint states')
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
graph, peer = process_graph.graph, process_graph.peer


def assert_as_sent(poses, states, readings) -> None:
    """Every pose has the joints of its stamp, and the reading, as the operator sent them."""
    sent = {stamp_of(each.header): each.displacement for each in readings}
    known = np.array([stamp in sent for stamp in poses.stamp.tolist()])
    assert known.mean() > 0.9  # the test may have missed some
    for stamp, displacement in zip(poses.stamp[known], poses.displacement[known], strict=True):
        assert np.array_equal(displacement, sent[int(stamp)])
    first = stamp_of(states[0].header)
    stamps = [stamp_of(each.header) - first for each in states]
    joints = np.array([each.position for each in states])
    truth = [np.interp(poses.stamp - first, stamps, column) for column in joints.T]
    assert np.abs(poses.joints - np.transpose(truth)).max() < WITHIN_ONE_STATE / 20
    fastest = np.abs(np.diff(joints, axis=0)).max()
    assert fastest > WITHIN_ONE_STATE  # a state too early or too late would have shown


def test_one_message_in_a_hundred_dropped_doubled_or_late_changes_no_pose_and_is_told(graph, peer):
    """What the operator sent is known here, as it was before anything happened to it."""
    states = peer.heard(JointState, '/raw/joint_states')
    readings = peer.heard(StylusDisplacements, '/raw/probe/displacements')
    graph.start(
        'operator',
        OPERATOR,
        '-r',
        '/joint_states:=/raw/joint_states',
        '-r',
        '/probe/displacements:=/raw/probe/displacements',
        locations='[3]',
        spheres='[6]',
        probe='active',
        wait=30.0,
    )
    relay = graph.relay()
    bag = graph.folder / 'bag'
    capture = graph.start(
        'capture', CAPTURE, mode='continuous', output=bag, placements=CONFIG / 'locations/faro.yaml'
    )
    end = time.monotonic() + 60
    while graph.poses() < 20:
        assert capture.process.poll() is None, graph.said(capture)
        assert time.monotonic() < end
        peer.spin(0.2)
    capture.process.send_signal(signal.SIGINT)
    while capture.process.poll() is None:
        peer.spin(0.1)
    code, line = graph.ended(capture)
    assert code == 0, line
    graph.provoked(relay)
    told = [each.search(line) for each in (TAKEN, LATE, BRIDGED)]
    assert all(told), line
    taken, came, late, bridged = (int(number) for found in told for number in found.groups())
    assert 'clock offset' in line
    poses = graph.recovered().poses
    assert set(zip(poses.location, poses.sphere, strict=True)) == {(3, 6)}
    assert taken == len(poses) >= 20
    assert_as_sent(poses, states, readings)
    assert came == len(read_recording(bag).streams.reading_stamp)
    assert min(late, bridged) > 0
    pair_hand_guided_bag(
        bag, graph.folder / 'again', HandGuidedRecord.read(read_note(bag, HAND_GUIDED_NOTE), 'bag')
    )
    again = read_measurement(graph.folder / 'again').poses
    assert np.array_equal(again.stamp, poses.stamp)
    assert np.array_equal(again.joints, poses.joints)


def test_a_bag_played_in_a_loop_with_its_clock_is_taken_in_and_said(graph, tmp_path):
    """The clock jumps back at every turn; the stamps do, too."""
    graph.start('operator', OPERATOR, locations='[3]', spheres='[6]', probe='active', wait=30.0)
    led = {'mode': 'continuous', 'placements': CONFIG / 'locations/faro.yaml'}
    capture = graph.start('recorded', CAPTURE, output=tmp_path / 'once', **led)
    graph.until(capture, lambda: graph.poses('once') > 10)
    capture.process.send_signal(signal.SIGINT)
    assert graph.ended(capture)[0] == 0
    graph._children._running[0].process.terminate()
    graph._children._running[0].process.wait(10)
    replay = Child(
        'replay',
        'calib_capture.nodes.replay_node',
        [str(tmp_path / 'once'), '--loop', '--clock', '--wait', '20'],
        graph.env,
        tmp_path / 'replay.log',
    )
    graph._children.start(replay)
    looped = graph.start('looped', CAPTURE, output=tmp_path / 'loop', use_sim_time='true', **led)
    once = read_measurement(tmp_path / 'once').poses
    graph.until(looped, lambda: graph.poses('loop') > 2.2 * len(once))
    looped.process.send_signal(signal.SIGINT)
    code, line = graph.ended(looped)
    assert code == 0, graph.said(looped)
    assert 'stamps of the joints began anew: ' in line
    loop = graph.recovered('loop').poses
    known = {stamp: row for row, stamp in enumerate(once.stamp.tolist())}
    pairs = [(row, known[s]) for row, s in enumerate(loop.stamp.tolist()) if s in known]
    assert len(pairs) > len(once)
    ours, theirs = (list(rows) for rows in zip(*pairs, strict=True))
    assert np.array_equal(loop.joints[ours], once.joints[theirs])
    assert np.array_equal(loop.displacement[ours], once.displacement[theirs])
