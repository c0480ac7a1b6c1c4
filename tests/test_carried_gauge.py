# SPDX-License-Identifier: Apache-2.0
"""One gauge that is carried between locations, with simulated arm and probe as processes."""

import os
import pty
import signal

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from process_graph import (  # noqa: F401
    CONFIG,
    PLACES,
    Graph,
    graph as graph,
    peer as peer,
)
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from calib_capture.motion import CollisionCheck, bodies_of
from calib_model.bags import read_measurement
from calib_model.descriptions import (
    parse_arm,
    parse_gauge,
    parse_placements,
    parse_probe,
    placements_yaml,
    read_description,
)
from calib_model.transforms import RigidTransform

pytestmark = [pytest.mark.system, pytest.mark.timeout(150)]
TWO = {'locations': '[3, 1]', 'spheres': '[2, 9]', 'poses': 3}
CARRY = 'carry the bar to location 1, then continue'
STILL = 1e-9  # rad: these encoders have no noise


def go_on(peer):
    client = peer.node.create_client(Trigger, '/capture/continue')
    while not client.service_is_ready():
        peer.spin(0.05)
    future = client.call_async(Trigger.Request())
    while not future.done():
        peer.spin(0.02)
    return future.result()


def test_nothing_moves_between_carry_and_continue_and_both_locations_get_their_poses(
    graph: Graph, peer
):
    graph.arm(scale=8.0)
    graph.probe()
    heard = peer.heard(JointState, '/joint_states')
    capture = graph.capture(**TWO, answer_timeout=0.5, give_up=1.0)
    graph.until(capture, lambda: peer.spin(0.05) or CARRY in graph.said(capture))
    assert 'location 3: 6 of 6 poses taken' in graph.said(capture)
    assert 'mind the arm' not in graph.said(capture)
    peer.spin(0.5)  # what was under way
    begin = len(heard)
    peer.spin(2.0)  # longer than it would wait for anybody but a person
    waited = np.array([message.position for message in heard[begin:]])
    assert len(waited) > 50
    assert np.ptp(waited, axis=0).max() < STILL
    assert gap(waited[0], (3, 1)) >= 0.1
    assert graph.poses() == 6
    answer = go_on(peer)
    assert (answer.success, answer.message) == (True, 'going on at location 1')
    code, line = graph.ended(capture)
    assert code == 0, line
    assert line.startswith(f'{graph.folder}/bag: 12 poses taken, 0 refused')
    assert graph.right() == 12
    assert read_measurement(graph.folder / 'bag').poses.location.tolist() == 6 * [3] + 6 * [1]


def gap(joints, locations):
    """How far arm and probe are from the gauge at any of some locations, m."""
    check = CollisionCheck(
        arm := read_description(CONFIG / 'arms/kuka_kr5_sixx_r650.yaml', parse_arm),
        bodies_of(
            arm,
            read_description(CONFIG / 'probes/active_trihedron.yaml', parse_probe),
            read_description(CONFIG / 'gauges/ball_bar_kr5.yaml', parse_gauge),
        ),
    )
    places, gaps = parse_placements(PLACES.read_text()), []
    for location in locations:
        check.put_gauge(places[location], -1)
        gaps.append(check.gap_outside(joints, seated=False))
    return min(gaps)


def test_a_signal_ends_what_waits_and_enter_goes_on_where_it_was_resumed(graph: Graph):
    graph.arm(scale=0.0)
    graph.probe()
    capture = graph.capture(**TWO)
    graph.until(capture, CARRY)
    capture.process.send_signal(signal.SIGINT)
    code, line = graph.ended(capture)
    assert code == 130, line
    assert graph.right() == 6
    hand, terminal = pty.openpty()
    os.write(hand, b'\n')  # typed before anything was asked
    again = graph.capture('again', **TWO, resume='true', terminal=terminal)
    os.close(terminal)
    graph.until(again, f'{CARRY} (Enter or /capture/continue); mind the arm')
    assert graph.poses() == 6
    os.write(hand, b'\n')
    code, line = graph.ended(again)
    assert code == 0, line
    os.close(hand)
    assert graph.right() == 12


def test_where_gauges_stand_everywhere_nobody_is_waited_for_and_what_is_not_finished_is_told(
    graph: Graph,
):
    graph.arm(scale=0.0)
    graph.probe()
    places = parse_placements(PLACES.read_text())
    off = RigidTransform(places[6].translation + [0.0, 0.0, 0.02], places[6].rotation_vector)
    told = graph.folder / 'told.yaml'
    told.write_text(placements_yaml({3: places[3], 1: places[1], 6: off}))
    capture = graph.capture(
        **{**TWO, 'locations': '[3, 6, 1]'}, between_locations='go', placements=told
    )
    code, line = graph.ended(capture)
    assert code == 1, line
    assert line.endswith('not finished: location 6')
    said = graph.said(capture)
    assert 'location 6: not finished: 0 of 6 poses taken, ' in said
    assert 'no contact' in said
    assert 'carry' not in said
    assert graph.right() == 12
