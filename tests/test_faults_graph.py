# SPDX-License-Identifier: Apache-2.0
"""The graph misbehaves: every pose in the bag is right all the same, or there is a line that says
what is wrong and a bag that opens. Arm, probe and capture are processes; in this world the arm
and the gauge are as described, so what is right is known."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_msgs.msg import String  # noqa: E402

from calib_bringup.processes import Child, Children, graph_environment  # noqa: E402
from calib_model.bag import read_measurement  # noqa: E402
from calib_model.bag_reader import read_messages  # noqa: E402
from calib_model.errors import BagError  # noqa: E402
from calib_model.kinematics import points  # noqa: E402
from calib_model.placement import parse_placements  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'ros2_ws/src/calib_bringup/config'
PLACES = CONFIG / 'locations/kr5.yaml'
ARM, PROBE = 'calib_capture.arm_node', 'selfcenter_probe.probe_node'
CAPTURE = 'calib_capture.capture_node'
RIGHT = 1e-6  # m: what PSDs of 16 bits round to is less
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
pytestmark = pytest.mark.timeout(120)


class Graph:
    """Starts nodes on one domain, and reads what they say."""

    def __init__(self, children: Children, domain: int, folder: Path) -> None:
        self.env, self.folder = graph_environment(domain), folder
        self._children = children
        self.world = folder / 'world.yaml'
        self.world.write_text('seed: 1\nnoise: none\n')  # and nothing is off

    def start(self, name: str, module: str, *more: str, **parameters: object) -> Child:
        given = ['--ros-args', *more]
        for key, value in parameters.items():
            given += ['-p', f'{key}:={value}']
        child = Child(name, module, given, self.env, self.folder / f'{name}.log')
        return self._children.start(child)

    def arm(
        self, name: str = 'arm', *more: str, scale: float = 5.0, **described: object
    ) -> Child:
        return self.start(name, ARM, *more, time_scale=scale, **described)

    def probe(self, name: str = 'probe', *more: str, **described: object) -> Child:
        return self.start(name, PROBE, *more, world=self.world, **described)

    def capture(self, name: str = 'capture', poses: int = 6, **asked: object) -> Child:
        return self.start(name, CAPTURE, **{
            'placements': PLACES, 'output': self.folder / 'bag', 'locations': '[3]',
            'spheres': '[1, 10]', 'poses_per_sphere': poses, 'pool': 1, **asked,
        })  # fmt: skip

    def said(self, child: Child) -> str:
        return (self.folder / f'{child.name}.log').read_text()

    def until(self, child: Child, done, seconds: float = 40.0) -> None:
        """Until `done`: a text that the process says, or a function."""
        end = time.monotonic() + seconds
        while not (done in self.said(child) if isinstance(done, str) else done()):
            assert child.process.poll() is None, self.said(child)
            assert time.monotonic() < end, f'{done} did not come: {self.said(child)}'
            time.sleep(0.05)

    def ended(self, child: Child, seconds: float = 60.0) -> tuple[int, str]:
        """The exit code and the last line."""
        code = child.process.wait(seconds)
        said = self.said(child)
        assert 'Traceback' not in said, said
        return code, said.strip().splitlines()[-1]

    def poses(self, bag: str = 'bag') -> int:
        """How many there are by now."""
        files = self.folder / bag
        try:
            return sum(each.topic == '/capture/poses' for each in read_messages(files))
        except BagError:  # not there yet, or just begun
            return 0

    def right(self, bag: str = 'bag') -> int:
        """How many poses are in the bag, each with its sphere where that really is."""
        measured = read_measurement(self.folder / bag)
        poses, gauge = measured.poses, measured.gauge
        places = parse_placements(PLACES.read_text(), 'kr5.yaml')
        truth = np.array([
            places[int(location)].apply(gauge.center(int(sphere)))
            for location, sphere in zip(poses.location, poses.sphere, strict=True)
        ])  # fmt: skip
        seen = points(
            measured.arm, poses.joints, measured.probe.flange_T_probe.apply(measured.centers())
        )
        off = np.linalg.norm(seen - truth, axis=1)
        assert off.max() < RIGHT, off
        return len(poses)


@pytest.fixture
def graph(domain, tmp_path):
    with Children() as children:
        yield Graph(children, domain, tmp_path)


class Peer:
    """A node of the test's own on the graph."""

    def __init__(self, domain: int) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node('gripper', context=self.context)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)

    def spin(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def peer(graph, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    peer = Peer(int(graph.env['ROS_DOMAIN_ID']))
    yield peer
    peer.close()


@pytest.fixture
def gripper(peer):
    """Another publisher of joint states, of a joint that is not the arm's."""
    publisher = peer.node.create_publisher(JointState, '/joint_states', 10)
    message = JointState(name=['jaw'], position=[0.01])
    peer.node.create_timer(0.01, lambda: publisher.publish(message))
    return peer.spin


@pytest.mark.parametrize(
    ('second', 'topic', 'named'),
    [('arm', '/joint_states', '/arm, /arm, /gripper'),
     ('probe', '/probe/displacements', '/probe, /probe')],
)  # fmt: skip
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
    ('probe', 'probes/active_trihedron.yaml', 'translation: [0.0, 0.0, 0.1]',
     'translation: [0.0, 0.001, 0.1]'),
    ('arm', 'arms/kuka_kr5_sixx_r650.yaml', 'a: 0.27', 'a: 0.2701'),
)  # fmt: skip


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
    code, line = graph.ended(graph.capture('resumed', output=bag, resume='true'))
    assert code == 2
    assert line.endswith('arm: was captured with another arm description, not gone on with')
    assert graph.right(bag.name) == len(taken)


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
    relay = Child('relay', 'tests.faulty_relay', ['1'],
                  {**graph.env, 'PYTHONPATH': f'{ROOT}:{graph.env.get("PYTHONPATH", "")}'},
                  graph.folder / 'relay.log')  # fmt: skip
    graph._children.start(relay)
    capture = graph.capture(poses=12, rest=0.1)  # a state lost at the end of a stop is not its end
    code, line = graph.ended(capture)
    assert code == 0, graph.said(capture)
    assert '24 poses taken' in line
    assert 'messages out of order' in line
    assert graph.right() == 24
    relay.process.send_signal(signal.SIGINT)
    relay.process.wait(10)
    said = graph.said(relay)
    assert all(f"'{topic} {fault}'" in said for topic in ('/joint_states', '/probe/displacements')
               for fault in ('dropped', 'doubled', 'out of order')), said  # fmt: skip


def test_a_bag_played_in_a_loop_with_its_clock_is_taken_in_and_said(graph, tmp_path):
    """The clock jumps back at every turn; the stamps do, too."""
    graph.start('operator', 'selfcenter_probe.operator_node', locations='[3]', spheres='[6]',
                probe='active', wait=30.0)  # fmt: skip
    led = {'mode': 'continuous', 'placements': CONFIG / 'locations/faro.yaml'}
    capture = graph.start('recorded', CAPTURE, output=tmp_path / 'once', **led)
    graph.until(capture, lambda: graph.poses('once') > 10)
    capture.process.send_signal(signal.SIGINT)
    assert graph.ended(capture)[0] == 0
    graph._children._running[0].process.terminate()
    graph._children._running[0].process.wait(10)
    replay = Child('replay', 'calib_capture.replay_node',
                   [str(tmp_path / 'once'), '--loop', '--clock', '--wait', '20'],
                   graph.env, tmp_path / 'replay.log')  # fmt: skip
    graph._children.start(replay)
    looped = graph.start('looped', CAPTURE, output=tmp_path / 'loop', use_sim_time='true', **led)
    once = read_measurement(tmp_path / 'once').poses
    graph.until(looped, lambda: graph.poses('loop') > 2.2 * len(once))
    looped.process.send_signal(signal.SIGINT)
    code, line = graph.ended(looped)
    assert code == 0, graph.said(looped)
    assert 'stamps of the joints began anew: ' in line
    loop = read_measurement(tmp_path / 'loop').poses
    known = {stamp: row for row, stamp in enumerate(once.stamp.tolist())}
    pairs = [(row, known[s]) for row, s in enumerate(loop.stamp.tolist()) if s in known]
    assert len(pairs) > len(once)
    ours, theirs = (list(rows) for rows in zip(*pairs, strict=True))
    assert np.array_equal(loop.joints[ours], once.joints[theirs])
    assert np.array_equal(loop.displacement[ours], once.displacement[theirs])
