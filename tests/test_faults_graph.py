# SPDX-License-Identifier: Apache-2.0
"""The graph misbehaves: every pose in the bag is right all the same, or there is a line that says
what is wrong and a bag that opens. Arm, probe and capture are processes; in this world the arm
and the gauge are as described, so what is right is known."""

from __future__ import annotations

import signal
import time

import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
import process_graph
from process_graph import ARM, CAPTURE, CONFIG, OPERATOR, PROBE
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from calib_model.bags import read_messages

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
graph, peer = process_graph.graph, process_graph.peer


@pytest.fixture
def gripper(peer):
    """Another publisher of joint states, of a joint that is not the arm's."""
    publisher = peer.node.create_publisher(JointState, '/joint_states', 10)
    message = JointState(name=['jaw'], position=[0.01])
    peer.node.create_timer(0.01, lambda: publisher.publish(message))
    return peer.spin


@pytest.mark.parametrize(
    ('second', 'topic', 'named'),
    [
        ('arm', '/joint_states', '/arm, /arm, /gripper'),
        ('probe', '/probe/displacements', '/probe, /probe'),
    ],
)
def test_a_second_source_ends_the_capture_and_a_gripper_does_not(
    graph, gripper, second, topic, named
):
    graph.arm()
    graph.probe()
    capture = graph.capture(poses=400)
    end = time.monotonic() + 40
    while graph.poses() < 5:
        assert capture.process.poll() is None, graph.said(capture)
        assert time.monotonic() < end
        gripper(0.1)
    getattr(graph, second)(f'second_{second}')
    while capture.process.poll() is None:
        assert time.monotonic() < end + 40
        gripper(0.1)
    code, line = graph.ended(capture)
    assert code == 2
    assert line.endswith(
        f'bag: {topic} comes from more than one publisher at a time ({named}): '
        'no reading can be paired for sure; leave one of them running'
    )
    assert graph.right() >= 5
    refused = graph.capture('again', output=graph.folder / 'again')  # both are there already
    end = time.monotonic() + 40
    while refused.process.poll() is None:
        assert time.monotonic() < end
        gripper(0.1)
    code, line = graph.ended(refused)
    assert code == 2
    assert f'{topic} comes from more than one publisher' in line
    if (graph.folder / 'again').exists():
        assert graph.poses('again') == 0


def test_whoever_comes_late_or_again_is_waited_for_and_every_pose_is_taken(graph):
    capture = graph.capture(poses=60, answer_timeout=1.0)
    graph.until(capture, 'waiting for /arm_description, /probe_description, /gauge_description')
    arm, probe = graph.arm(scale=0), graph.probe()
    for node, begin, topic in (
        (probe, graph.probe, '/probe/displacements'),
        (arm, lambda name: graph.arm(name, scale=0), '/joint_states'),
    ):
        before = graph.poses()
        graph.until(capture, lambda before=before: graph.poses() > before + 3)
        node.process.kill()
        graph.until(capture, f'waiting for {topic}, silent for')
        begin(f'{node.name}_again')
    code, line = graph.ended(capture)
    assert code == 0, graph.said(capture)
    assert 'bag: 120 poses taken, 0 refused' in line
    assert graph.right() == 120


def test_a_probe_that_stays_away_ends_it_with_a_line_and_it_is_gone_on_with_later(graph):
    graph.arm(scale=0)
    probe = graph.probe()
    asked = {'poses': 40, 'answer_timeout': 0.5, 'resume': 'true'}
    capture = graph.capture(**asked, give_up=4.0)
    graph.until(capture, lambda: graph.poses() > 3)
    probe.process.kill()
    code, line = graph.ended(capture)
    assert code == 2
    assert 'bag: no pose has been answered for' in line
    assert '; waited for /probe/displacements, silent for' in line
    there = graph.right()
    graph.probe('probe_again')
    again = graph.capture('again', **asked)
    code, line = graph.ended(again)
    assert code == 0, graph.said(again)
    assert f'bag: {there} poses are there already' in graph.said(again)
    assert graph.right() == 80


CHANGES = (
    ('gauge', 'gauges/ball_bar_kr5.yaml', 'sphere_diameter: 0.022', 'sphere_diameter: 0.0221'),
    (
        'probe',
        'probes/active_trihedron.yaml',
        'translation: [0.0, 0.0, 0.1]',
        'translation: [0.0, 0.001, 0.1]',
    ),
    ('arm', 'arms/kuka_kr5_sixx_r650.yaml', 'a: 0.27', 'a: 0.2701'),
)


def test_another_description_ends_the_capture_with_a_line_and_no_pose_is_of_both(graph, peer):
    """Arm and probe are killed in mid-capture and started anew with another one."""
    nodes = {'arm': graph.arm(scale=0), 'probe': graph.probe()}
    for what, file, value, other in CHANGES:
        bag = graph.folder / f'of_one_{what}'
        capture = graph.capture(bag.name, poses=400, output=bag)
        graph.until(capture, lambda name=bag.name: graph.poses(name) > 5)
        text = (CONFIG / file).read_text()
        assert value in text
        changed = graph.folder / f'other_{what}.yaml'
        changed.write_text(text.replace(value, other))
        if what in nodes:
            nodes[what].process.kill()
            nodes[what].process.wait(10)
            time.sleep(0.3)  # for what was under way
        began = time.time_ns()
        if what in nodes:
            begin = graph.arm if what == 'arm' else graph.probe
            nodes[what] = begin(f'other_{what}', **{what: changed})
        else:
            latched = peer.node.create_publisher(String, '/gauge_description', LATCHED)
            latched.publish(String(data=changed.read_text()))
        while capture.process.poll() is None:
            peer.spin(0.1)
        code, line = graph.ended(capture)
        assert code == 2
        assert f'{what}: /{what}_description: another {what} than before is described' in line
        assert line.endswith('; start the capture anew for it')
        taken = [each for each in read_messages(bag) if each.topic == '/capture/poses']
        assert graph.right(bag.name) == len(taken) > 5
        if what in nodes:
            assert max(each.log_time for each in taken) < began
        else:
            peer.node.destroy_publisher(latched)


def test_of_two_captures_the_second_is_told_and_the_first_goes_on(graph):
    graph.arm()
    graph.probe()
    first = graph.capture('first', poses=400)
    graph.until(first, lambda: graph.poses() >= 3)
    same = graph.capture('same')
    other = graph.capture('other', output=graph.folder / 'other')
    resumed = graph.capture('resumed', resume='true', mode='continuous')
    code, line = graph.ended(same)
    assert (code, 'bag: exists already, a bag is never overwritten' in line) == (2, True), line
    code, line = graph.ended(other)
    assert code == 2
    assert line.endswith(
        '/arm_controller/joint_trajectory: another capture commands the arm (/capture): '
        'start when it is done'
    )
    assert not (graph.folder / 'other').exists()
    code, line = graph.ended(resumed)
    assert (code, 'bag: is being written by another capture' in line) == (2, True), line
    before = graph.poses()
    graph.until(first, lambda: graph.poses() > before + 3)
    first.process.send_signal(signal.SIGINT)
    code, _ = graph.ended(first)
    assert code == 130
    assert graph.right() > before


def test_one_message_in_a_hundred_dropped_doubled_or_late_changes_no_pose(graph):
    raw = ('-r', '/joint_states:=/raw/joint_states')
    graph.arm('arm', *raw)
    graph.probe('probe', *raw, '-r', '/probe/displacements:=/raw/probe/displacements')
    relay = graph.relay()
    capture = graph.capture(poses=12, rest=0.1)  # a state lost at the end of a stop is not its end
    code, line = graph.ended(capture)
    assert code == 0, graph.said(capture)
    assert '24 poses taken' in line
    assert 'messages out of order' in line
    assert graph.right() == 24
    graph.provoked(relay)


def test_every_node_tells_of_a_parameter_that_it_does_not_have(graph):
    """Of one that is misspelt, and of one in a file that is for other nodes as well."""
    shared = graph.folder / 'shared.yaml'
    shared.write_text('/**:\n  ros__parameters: {of_another_node: 1, use_sim_time: false}\n')
    nodes = {
        ARM: ('arm', 'time_scal', 'time_scale'),
        PROBE: ('probe', 'gague', 'gauge'),
        CAPTURE: ('capture', 'spacng', 'spacing'),
        'calib_solver.nodes.solver_node': ('solver', 'magnificaton', 'magnification'),
        OPERATOR: ('operator', 'locatons', 'locations'),
    }
    started = {
        name: graph.start(name, module, '--params-file', str(shared), **{wrong: 1})
        for module, (name, wrong, _) in nodes.items()
    }
    for name, wrong, meant in nodes.values():
        line = f"no parameter '{wrong}': did you mean '{meant}'? no parameter 'of_another_node'"
        graph.until(started[name], line)
        said = [each for each in graph.said(started[name]).splitlines() if '[WARN]' in each]
        assert len(said) == 1, said
        assert said[0].endswith(f'[{name}]: {line}')
