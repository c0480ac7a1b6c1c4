# SPDX-License-Identifier: Apache-2.0
"""`/capture/run` and `/capture/teach` as processes, called as any client calls them."""

from __future__ import annotations

import functools
import math
import time

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from action_msgs.msg import GoalStatus
from calib_interfaces.action import Capture
from calib_interfaces.srv import Teach
from perfect_probe import PerfectProbe
from rclpy.action import ActionClient
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_msgs.msg import String
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from calib_capture.motion import Leg, motion_limits
from calib_capture.nodes.messages import joint_trajectory
from calib_capture.program import (
    Planner,
    ProgramSettings,
)
from calib_model.bags import read_measurement
from calib_model.descriptions import placements_yaml
from calib_model.nodes import qos_of
from calib_model.topics import CAPTURE_MARKERS, JOINT_TRAJECTORY
from calib_model.transforms import RigidTransform

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
ARM, CAPTURE = 'calib_capture.nodes.arm_node', 'calib_capture.nodes.capture_node'


class Client:
    """Calls the capture node from the node of the perfect probe."""

    def __init__(self, perfect):
        self.perfect = perfect
        self.action = ActionClient(perfect.node, Capture, '/capture/run')
        self.teach_service = perfect.node.create_client(Teach, '/capture/teach')
        self.commands = perfect.node.create_publisher(
            JointTrajectory, JOINT_TRAJECTORY.name, qos_of(JOINT_TRAJECTORY)
        )
        self.feedback = []
        self.shown = []
        perfect.node.create_subscription(
            MarkerArray,
            CAPTURE_MARKERS.name,
            lambda message: self.shown.append(message.markers),
            qos_of(CAPTURE_MARKERS),
        )
        self.setter = AsyncParameterClient(perfect.node, 'capture')

    def until(self, condition, seconds=60.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, 'nothing comes of it'
            self.perfect.executor.spin_once(timeout_sec=0.05)

    def answer(self, future):
        self.until(future.done)
        return future.result()

    def asked(self, service, request):
        """The answer; the first may get lost where the two ends have not both met by then."""
        for _ in range(5):
            future, end = service.call_async(request), time.monotonic() + 10
            self.until(lambda f=future, e=end: f.done() or time.monotonic() > e)
            if future.done():
                return future.result()
        raise AssertionError('no answer to any of five requests')

    def send(self, **goal):
        self.until(self.action.server_is_ready)

        def note(message):
            self.feedback.append(message.feedback)

        return self.answer(self.action.send_goal_async(Capture.Goal(**goal), note))

    def result(self, handle):
        wrapped = self.answer(handle.get_result_async())
        return wrapped.status, wrapped.result

    def teach(self, location, sphere):
        self.until(self.teach_service.service_is_ready)
        request = Teach.Request(location=location, sphere=sphere)
        # on a busy machine states may come too far apart for an arm at rest, or not be met yet
        passing = 'has not stood still', 'no joint states', 'not there yet'
        for _ in range(20):
            answer = self.asked(self.teach_service, request)
            if not any(said in answer.message for said in passing):
                break
            self.until(functools.partial(self._later_than, self.perfect.before[0] + 4e8))
        return answer

    def _later_than(self, stamp):
        return self.perfect.before[0] > stamp

    def set(self, name, value):
        self.until(self.setter.services_are_ready)
        parameter = Parameter(name, value=value).to_parameter_msg()
        return self.answer(self.setter.set_parameters([parameter])).results[0]

    def stand(self, joints):
        """Let the arm go to a posture and rest there."""
        self.until(lambda: self.commands.get_subscription_count() and self.perfect.before)
        arm = self.perfect.arm
        leg = Leg(self.perfect.before[1], motion_limits(arm))
        leg.to(joints)
        self.commands.publish(joint_trajectory(arm.joint_names, leg.trajectory()))
        self.until(lambda: np.abs(self.perfect.before[1] - joints).max() < 1e-9)
        since = self.perfect.before[0]
        self.until(lambda: self.perfect.before[0] - since > 5e8)


@pytest.fixture
def client(domain, kr5, probe, gauge, placements, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    perfect = PerfectProbe(domain, kr5, probe, gauge, placements)
    yield Client(perfect)
    perfect.close()


def start(graph, config, time_scale=0, **given):
    graph.start(
        ARM,
        arm=config / 'arms' / 'kuka_kr5_sixx_r650.yaml',
        time_scale=time_scale,
        noise=0.0,
        step=0.0,
    )
    places = given.pop('placements', config / 'locations' / 'kr5.yaml')
    return graph.start(CAPTURE, serve='true', placements=places, **given)


def test_a_goal_measures_tells_how_far_it_is_and_answers_with_bag_and_counts(
    graph, client, config, tmp_path
):
    start(graph, config)
    goal = {'locations': [3], 'spheres': [1, 10], 'poses_per_sphere': 6}
    handle = client.send(**goal, bag=str(tmp_path / 'bag'))
    assert handle.accepted
    status, result = client.result(handle)
    assert (status, result.success) == (GoalStatus.STATUS_SUCCEEDED, True), result.message
    assert (result.bag, result.taken, result.refused) == (str(tmp_path / 'bag'), 12, 0)
    poses = read_measurement(tmp_path / 'bag').poses
    assert sorted(poses.sphere) == [1] * 6 + [10] * 6
    assert client.feedback[-1].planned == 12
    assert client.feedback[-1].location == 3
    # our own errors are answers, and the node lives on
    for wrong, said in (
        ({**goal, 'bag': str(tmp_path / 'bag')}, 'exists already'),
        ({**goal, 'locations': [77], 'bag': str(tmp_path / 'b2')}, 'location 77 has no place'),
        ({**goal, 'spheres': [99], 'bag': str(tmp_path / 'b3')}, 'sphere 99'),
    ):
        status, result = client.result(client.send(**wrong))
        assert (status, result.success) == (GoalStatus.STATUS_ABORTED, False)
        assert said in result.message
        assert result.bag == ''
    again = client.send(**goal, bag=str(tmp_path / 'again'))
    assert client.result(again)[1].taken == 12
    client.until(lambda: {'taken', 'poses'} <= {marker.ns for marker in client.shown[-1]})
    by_name = {(marker.ns, marker.id): marker for marker in client.shown[-1]}
    assert len(by_name['taken', 0].points) == len(by_name['poses', 3].points) == 2 * 12


def test_parameters_are_for_the_next_goal_and_a_goal_can_go_on_with_a_bag(
    graph, client, config, tmp_path
):
    start(graph, config)
    goal = {'locations': [3], 'spheres': [1], 'bag': str(tmp_path / 'bag')}
    assert client.set('poses_per_sphere', 4).successful
    assert client.result(client.send(**goal))[1].taken == 4
    assert client.result(client.send(**goal, resume=True))[1].message.endswith(
        'complete with 4 poses'
    )
    for name, value, said in (
        ('poses_per_sphere', 0, 'out of range'),
        ('offsets', [0.5, 0.1], 'expected [shortest, longest]'),
        ('placements', 'nowhere.yaml', 'nowhere.yaml'),
        ('arm', 'other.yaml', 'read-only'),
    ):
        refused = client.set(name, value)
        assert not refused.successful
        assert said in refused.reason


def test_cancel_stops_the_arm_and_closes_the_bag_and_a_second_goal_is_refused(
    graph, client, config, tmp_path
):
    start(graph, config, time_scale=5)
    goal = {'locations': [3], 'spheres': [1], 'poses_per_sphere': 200}
    handle = client.send(**goal, bag=str(tmp_path / 'bag'))
    client.until(lambda: len(client.perfect.poses) >= 5)
    assert not client.send(**goal, bag=str(tmp_path / 'other')).accepted
    assert not client.teach(3, 1).success
    client.answer(handle.cancel_goal_async())
    status, result = client.result(handle)
    assert (status, result.success) == (GoalStatus.STATUS_CANCELED, False)
    assert result.message.startswith('stopped: ')
    assert len(read_measurement(tmp_path / 'bag').poses) == result.taken >= 5
    assert len(client.feedback) >= 2
    assert not (tmp_path / 'other').exists()
    # of 200 poses it had taken a few: what it still did would be seen for ten seconds and more
    since, here = client.perfect.before

    def stood():
        nonlocal since, here
        stamp, joints = client.perfect.before
        if not np.array_equal(joints, here):
            since, here = stamp, joints
        return stamp - since > 5e9  # longer than it rests for a pose

    client.until(stood, seconds=15.0)
    assert result.taken < 100


def test_a_taught_location_is_where_the_next_run_measures(
    graph, client, kr5, probe, gauge, placements, config, tmp_path
):
    """The node is told wrong places; two spheres probed by hand put location 3 right."""
    turned = RigidTransform(np.array([0.0, 0.0, 3.0]), np.zeros(3))
    (tmp_path / 'wrong.yaml').write_text(placements_yaml({3: turned}))
    kept = tmp_path / 'taught.yaml'
    capture = start(graph, config, placements=tmp_path / 'wrong.yaml', taught=kept)
    settings = ProgramSettings(spheres=(1, 10, 14), poses_per_sphere=3)
    program = Planner(kr5, probe, gauge, settings).program(placements, [3])
    posture = {plan.sphere: plan.poses[0].joints for plan in program.spheres}
    client.stand(posture[1])
    first = client.teach(3, 1)
    assert first.success, first.message
    assert math.isnan(first.length_error)
    true_center = placements[3].apply(gauge.center(1))
    assert np.abs(first.center - true_center).max() < 1e-7
    client.stand(posture[10])
    taken_for_another = client.teach(3, 14)
    assert not taken_for_another.success
    assert 'is it these spheres and this gauge?' in taken_for_another.message
    certified = math.dist(gauge.center(1), gauge.center(14))
    seen = math.dist(gauge.center(1), gauge.center(10))
    assert taken_for_another.length_error == pytest.approx(seen - certified, abs=1e-6)
    client.stand(posture[14])
    last = client.teach(3, 14)
    assert last.success, last.message
    assert abs(last.length_error) < 1e-7
    bars = {marker.id: marker for marker in client.shown[-1] if marker.ns == 'gauge'}
    seen = np.array([[p.x, p.y, p.z] for p in bars[3].points])
    expected = [placements[3].apply(gauge.center(number)) for number in gauge.numbers]
    assert np.abs(seen - expected).max() < 1e-5  # the bar may be turned about itself
    handle = client.send(
        locations=[3], spheres=[1, 10], poses_per_sphere=4, bag=str(tmp_path / 'bag')
    )
    status, result = client.result(handle)
    assert result.success, result.message
    assert result.taken == 8
    capture.terminate()
    assert capture.wait(10) == 0
    # it is known to the next node too, which without other places goes nowhere else
    graph.start(CAPTURE, serve='true', taught=kept)
    handle = client.send(spheres=[1], poses_per_sphere=4, bag=str(tmp_path / 'second'))
    assert client.result(handle)[1].taken == 4
    poses = read_measurement(tmp_path / 'second').poses
    assert set(poses.location) == {3}


def test_a_gauge_carried_elsewhere_is_taught_there_and_the_rest_is_planned_from_it(
    graph, client, kr5, probe, gauge, placements, config, tmp_path
):
    """Location 1 was to be 25 mm from where the bar is put down."""
    off = placements[1].translation + [0.0, 0.015, -0.02]
    told = {3: placements[3], 1: RigidTransform(off, placements[1].rotation_vector)}
    (tmp_path / 'told.yaml').write_text(placements_yaml(told))
    start(graph, config, placements=tmp_path / 'told.yaml')
    settings = ProgramSettings(spheres=(2, 12), poses_per_sphere=2)
    program = Planner(kr5, probe, gauge, settings).program(placements, [1])
    posture = {plan.sphere: plan.poses[0].joints for plan in program.spheres}
    goal = {'locations': [3, 1], 'spheres': [2, 12], 'poses_per_sphere': 2}
    handle = client.send(**goal, bag=str(tmp_path / 'bag'))
    client.until(lambda: client.feedback and client.feedback[-1].location == 1)
    assert (client.feedback[-1].sphere, client.feedback[-1].taken) == (0, 4)
    for sphere in posture:
        client.stand(posture[sphere])
        assert 'is to stand at location 1 now' in client.teach(3, sphere).message
        taught = client.teach(1, sphere)
        assert taught.success, taught.message
    go_on = client.perfect.node.create_client(Trigger, '/capture/continue')
    assert client.asked(go_on, Trigger.Request()).message == 'going on at location 1'
    status, result = client.result(handle)
    assert (status, result.success) == (GoalStatus.STATUS_SUCCEEDED, True), result.message
    poses = read_measurement(tmp_path / 'bag').poses
    assert poses.location.tolist() == 4 * [3] + 4 * [1]


def test_what_cannot_be_taught_is_said(graph, client, config, tmp_path):
    start(graph, config)
    client.until(lambda: client.perfect.before)
    answers = []

    def told():
        answers.append(client.teach(1, 1))
        return 'the probe cannot be read here: no contact' in answers[-1].message

    client.until(told, 20.0)  # until the node has heard of arm and probe
    assert not any(answer.success for answer in answers)
    assert not client.teach(1, 99).success
    assert 'counted from 1' in client.teach(0, 1).message
    # from now on nobody knows of which probe the readings are
    client.perfect.latched[0].publish(String(data='another: probe\n'))
    client.until(
        lambda: '/probe_description: another probe than before' in client.teach(1, 1).message, 10.0
    )
    refused = client.result(client.send(locations=[3], spheres=[1], bag=str(tmp_path / 'bag')))
    assert 'another probe than before is described there, by /probe' in refused[1].message
    assert not (tmp_path / 'bag').exists()
