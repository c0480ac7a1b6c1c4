# SPDX-License-Identifier: Apache-2.0
"""The whole capture as processes: the arm, a probe that knows no world, and the capture node."""

from __future__ import annotations

import signal
import time
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from calib_interfaces.msg import StylusDisplacements
from perfect_probe import PerfectProbe
from std_msgs.msg import String

from calib_capture.recording import CLEAR
from calib_model.bags import (
    read_measurement,
    read_messages,
)
from calib_model.descriptions import probe_yaml
from calib_model.kinematics import points
from calib_model.nodes import (
    qos_of,
    stamp_of,
)
from calib_model.topics import PROBE_DISPLACEMENTS

pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
ARM, CAPTURE = 'calib_capture.nodes.arm_node', 'calib_capture.nodes.capture_node'


@pytest.fixture
def perfect(domain, kr5, probe, gauge, placements, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    perfect = PerfectProbe(domain, kr5, probe, gauge, placements)
    yield perfect
    perfect.close()


@pytest.fixture
def asked(config, tmp_path):
    """Twelve poses of two spheres at one location."""
    return {
        'placements': config / 'locations' / 'kr5.yaml',
        'output': tmp_path / 'bag',
        'locations': '[3]',
        'spheres': '[1, 10]',
        'poses_per_sphere': 6,
    }


@pytest.fixture
def arm_node(graph, config):
    path = config / 'arms' / 'kuka_kr5_sixx_r650.yaml'
    return graph.start(ARM, arm=path, time_scale=0, noise=0.0, step=0.0)


def test_every_pose_is_taken_published_and_recorded(graph, perfect, asked, arm_node, tmp_path):
    capture = graph.start(CAPTURE, **asked)
    perfect.spin_while(capture)
    said, error = capture.communicate()
    assert capture.returncode == 0, error
    assert said.strip().splitlines()[-1].startswith(f'{tmp_path}/bag: 12 poses taken, 0 refused')
    measured = read_measurement(tmp_path / 'bag')
    poses = measured.poses
    assert sorted(zip(poses.location, poses.sphere, strict=True)) == [(3, 1)] * 6 + [(3, 10)] * 6
    assert (poses.readings >= 2).all()
    # a perfect arm and gauge: every reading puts the sphere where its place says
    p_flange = measured.probe.flange_T_probe.apply(measured.centers())
    p_base = points(measured.arm, poses.joints, p_flange)
    off = np.linalg.norm(p_base[:, None] - perfect.spheres[None], axis=2).min(axis=1)
    assert off.max() < 1e-7
    topics = {message.topic for message in read_messages(tmp_path / 'bag')}
    assert topics == {
        '/arm_description',
        '/probe_description',
        '/gauge_description',
        '/joint_states',
        '/probe/displacements',
        '/capture/poses',
        '/arm_controller/joint_trajectory',
    }
    perfect.executor.spin_once(timeout_sec=0.2)
    assert len(perfect.poses) == 12
    assert [stamp_of(pose.header) for pose in perfect.poses] == poses.stamp.tolist()


def test_readings_lost_once_are_taken_the_second_time(graph, perfect, asked, arm_node, tmp_path):
    lost, left = [], []

    def silent(joints):
        """Loses what is read at the first posture with contact, until the arm leaves it."""
        if not lost and not perfect.touched(joints)[1].any():
            lost.append(joints)
        if lost and not np.allclose(joints, lost[0]):
            left.append(joints)
        return bool(lost) and not left

    perfect.silent = silent
    capture = graph.start(CAPTURE, **asked, answer_timeout=1.0)
    perfect.spin_while(capture)
    assert capture.returncode == 0, capture.communicate()
    joints = read_measurement(tmp_path / 'bag').poses.joints
    assert len(joints) == 12
    first = np.abs(joints - lost[0]).max(axis=1).argmin()
    assert np.abs(joints[first] - lost[0]).max() < 1e-9
    assert first >= 3


def test_ctrl_c_stops_the_arm_and_leaves_a_bag_that_opens(graph, perfect, asked, config, tmp_path):
    path = config / 'arms' / 'kuka_kr5_sixx_r650.yaml'
    graph.start(ARM, arm=path, time_scale=5, noise=0.0, step=0.0)
    capture = graph.start(CAPTURE, **{**asked, 'poses_per_sphere': 200})
    end = time.monotonic() + 60
    while len(perfect.poses) < 5 and time.monotonic() < end:
        perfect.executor.spin_once(timeout_sec=0.05)
    capture.send_signal(signal.SIGINT)
    perfect.spin_while(capture)
    said, error = capture.communicate()
    assert capture.returncode == 130, error
    assert 'stopped: ' in said
    assert 'Traceback' not in error
    poses = read_measurement(tmp_path / 'bag').poses
    assert len(poses) >= 5
    assert {stamp_of(p.header) for p in perfect.poses[:5]} <= set(poses.stamp.tolist())
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()
    for _ in range(20):
        perfect.executor.spin_once(timeout_sec=0.02)
    here = perfect.before[1]
    for _ in range(20):
        perfect.executor.spin_once(timeout_sec=0.02)
    assert np.array_equal(perfect.before[1], here)


def test_an_arm_that_goes_silent_ends_the_run_with_a_line_and_a_bag(
    graph, perfect, asked, arm_node, tmp_path
):
    capture = graph.start(
        CAPTURE, **{**asked, 'poses_per_sphere': 400}, answer_timeout=0.5, give_up=2.0
    )
    end = time.monotonic() + 60
    while len(perfect.poses) < 5 and time.monotonic() < end:
        perfect.executor.spin_once(timeout_sec=0.05)
    arm_node.send_signal(signal.SIGSTOP)
    try:
        perfect.spin_while(capture)
    finally:
        arm_node.send_signal(signal.SIGCONT)
    _, error = capture.communicate()
    assert capture.returncode == 2
    assert 'no pose has been answered for' in error
    assert len(error.strip().splitlines()) == 1
    assert len(read_measurement(tmp_path / 'bag').poses) >= 5


def test_a_driver_in_millimetres_is_named_at_its_first_readings(
    graph, perfect, asked, arm_node, tmp_path
):
    metres = perfect.touched

    def millimetres(joints):
        read, status = metres(joints)
        return 1e3 * read + 0.7, status  # a driver's zero is its own, too

    perfect.touched = millimetres
    capture = graph.start(CAPTURE, **asked)
    perfect.spin_while(capture)
    _, error = capture.communicate()
    assert capture.returncode == 2
    assert '/probe/displacements, where a stylus moves by 0.003 m at most: is its driver' in error
    assert len(error.strip().splitlines()) == 1
    assert not perfect.poses


def test_a_reading_now_and_then_that_no_stylus_makes_is_left_out_and_counted(
    graph, perfect, asked, arm_node, tmp_path
):
    metres, count = perfect.touched, 0

    def now_and_then(joints):
        nonlocal count
        read, status = metres(joints)
        count += 1
        return (read + 4.0, status) if count % 7 == 3 else (read, status)

    perfect.touched = now_and_then
    capture = graph.start(CAPTURE, **asked)
    perfect.spin_while(capture)
    said, error = capture.communicate()
    assert capture.returncode == 0, error
    assert 'longer than any stroke left out' in said
    taken = read_measurement(tmp_path / 'bag').poses
    assert len(taken) == 12
    assert np.abs(taken.displacement).max() < 0.004


def test_of_a_probe_started_anew_no_pose_is_taken_before_it_can_have_described_itself(
    graph, perfect, asked, arm_node, probe, tmp_path
):
    capture = graph.start(CAPTURE, **{**asked, 'poses_per_sphere': 400})
    end = time.monotonic() + 60
    while len(perfect.poses) < 5 and time.monotonic() < end:
        perfect.executor.spin_once(timeout_sec=0.05)
    perfect.node.destroy_publisher(perfect.publisher)
    time.sleep(0.3)  # for what was under way
    began = time.time_ns()
    perfect.publisher = perfect.node.create_publisher(
        StylusDisplacements, PROBE_DISPLACEMENTS.name, qos_of(PROBE_DISPLACEMENTS)
    )
    end = time.monotonic() + 3 * CLEAR
    while time.monotonic() < end:
        perfect.executor.spin_once(timeout_sec=0.05)
    assert capture.poll() is None
    text = probe_yaml(replace(probe, name='other'))
    perfect.latched[0].publish(String(data=text))
    perfect.spin_while(capture)
    _, error = capture.communicate()
    assert capture.returncode == 2
    assert '/probe_description: another probe than before is described there, by /probe' in error
    assert len(read_measurement(tmp_path / 'bag').poses) >= 5
    later = [each for each in read_messages(tmp_path / 'bag') if each.log_time > began]
    topics = {each.topic for each in later}
    assert {'/joint_states'} <= topics <= {'/joint_states', '/arm_controller/joint_trajectory'}


def test_it_says_what_it_waits_for_and_gives_up(graph, asked):
    capture = graph.start(CAPTURE, **asked, wait_timeout=4.0)
    said, error = capture.communicate(timeout=60)
    assert capture.returncode == 2
    assert 'waiting for /arm_description, /probe_description, /gauge_description' in said
    assert 'in vain for /arm_description' in error
    assert not asked['output'].exists()


def test_a_passive_probe_is_not_sent_about_by_a_program(graph, perfect, arm_node, asked, config):
    capture = graph.start(CAPTURE, **asked, probe=config / 'probes' / 'passive_seat_kr5.yaml')
    perfect.spin_while(capture)
    _, error = capture.communicate(timeout=60)
    assert capture.returncode == 2
    assert 'passive probe, which does not tell where a commanded arm really is' in error
    assert not asked['output'].exists()


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'placements': '/nowhere/kr5.yaml'}, '/nowhere/kr5.yaml: cannot be read'),
        ({'poses_per_sphere': 0}, "parameter 'poses_per_sphere': expected a number from 1"),
        ({'offsets': '[0.002, 0.001]'}, "parameter 'offsets': expected [shortest, longest] in m"),
        ({'dwell': 'long'}, "parameter 'dwell': expected a number"),
        ({'output': '/'}, '/: exists already, a bag is never overwritten'),
    ],
)
def test_bad_parameters_end_it_with_two_and_one_line(graph, asked, parameters, said):
    capture = graph.start(CAPTURE, **{**asked, **parameters})
    _, error = capture.communicate(timeout=30)
    assert capture.returncode == 2
    assert said in error
    assert len(error.strip().splitlines()) == 1
