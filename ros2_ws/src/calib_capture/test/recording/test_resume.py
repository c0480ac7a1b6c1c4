# SPDX-License-Identifier: Apache-2.0
"""A capture that is killed: nothing acknowledged is lost, and it is gone on with to the end."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np
import pytest

from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_capture.recording.resume import begun, remaining
from calib_model.bags import (
    BagWriter,
    read_measurement,
    read_messages,
    recover,
    write_descriptions,
    write_measurement,
)
from calib_model.errors import BagError
from calib_model.measurement import Measurement, ProbingSet

KILLS = int(os.environ.get('CAPTURE_KILLS', '3'))
SEED = int(os.environ.get('CAPTURE_KILLS_SEED', '4'))
pytestmark = pytest.mark.timeout(240 + 30 * KILLS)
ARM, CAPTURE = 'calib_capture.nodes.arm_node', 'calib_capture.nodes.capture_node'


def plan(sphere, count=5, spares=2):
    def pose(i):
        return PlannedPose(1, sphere, np.full(6, 0.1 * i), np.zeros(3))

    poses = tuple(pose(i) for i in range(1, count + 1))
    return SpherePlan(1, sphere, poses, tuple(pose(-i) for i in range(1, spares + 1)), count, 0)


def taken(*spheres_and_rows):
    """Poses of location 1: sphere and joints in tenths."""
    spheres = np.array([sphere for sphere, _ in spheres_and_rows])
    count = len(spheres)
    joints = np.array([np.full(6, 0.1 * row) for _, row in spheres_and_rows])
    return ProbingSet(
        np.ones(count, dtype=int),
        spheres,
        joints,
        np.zeros((count, 3)),
        np.arange(count),
        np.full(count, 3),
    )


def rows(poses):
    return [round(pose.joints[0] * 10) for pose in poses]


def test_what_was_taken_is_not_planned_again():
    left = remaining(Program((plan(1), plan(6))), taken((1, 1), (1, 2), (1, 3)))
    assert [rows(each.poses) for each in left.spheres] == [[4, 5], [1, 2, 3, 4, 5]]
    assert len(left.poses) == 7


def test_a_spare_that_was_taken_stands_for_a_refused_pose():
    left = remaining(Program((plan(1),)), taken((1, 1), (1, 3), (1, -1)))
    assert rows(left.spheres[0].poses) == [4, 5]
    assert rows(left.spheres[0].spares) == [-2]


def test_nothing_is_left_of_a_complete_set():
    complete = taken(*((1, row) for row in (1, 2, -1, 4, 5)))
    assert remaining(Program((plan(1),)), complete).poses == ()


def test_a_bag_of_another_arm_is_not_gone_on_with(kr5, probe, gauge, tmp_path):
    poses = replace(taken((1, 1)), displacement=np.full((1, 3), 1e-3))
    write_measurement(tmp_path / 'bag', Measurement(kr5, probe, gauge, poses, 'here'))
    assert begun(tmp_path / 'bag', kr5, probe, gauge).taken == 1
    with pytest.raises(BagError, match='another arm description'):
        begun(tmp_path / 'bag', replace(kr5, name='other'), probe, gauge)
    with BagWriter(tmp_path / 'no_pose') as bag:  # yet readings, of that probe
        write_descriptions(bag, kr5, probe, gauge, 1)
    assert begun(tmp_path / 'no_pose', kr5, probe, gauge).taken == 0
    with pytest.raises(BagError, match='another probe description'):
        begun(tmp_path / 'no_pose', kr5, replace(probe, name='other'), gauge)


def test_a_capture_killed_before_its_first_words_is_begun_anew(kr5, probe, gauge, tmp_path):
    """Between the folder, its first file and its metadata.yaml."""
    for number, left in enumerate(([], ['bag_0.mcap'], ['bag_0.mcap', '.metadata.yaml.7.part'])):
        bag = tmp_path / str(number) / 'bag'
        bag.mkdir(parents=True)
        for name in left:
            (bag / name).touch()
        assert begun(bag, kr5, probe, gauge).files == ()
        assert not bag.exists()


@pytest.mark.system
def test_a_killed_capture_keeps_every_acknowledged_pose_and_resumes_to_a_complete_set(
    graph, domain, kr5, probe, gauge, placements, config, tmp_path, monkeypatch
):
    """Killed `CAPTURE_KILLS` times: after some poses, or at any moment from its start on."""
    pytest.importorskip('rclpy', reason='no ROS 2 here')
    pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
    from perfect_probe import PerfectProbe

    from calib_model.nodes import stamp_of

    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    perfect = PerfectProbe(domain, kr5, probe, gauge, placements)
    each_sphere, bag = 15 * KILLS, tmp_path / 'bag'
    try:
        graph.start(
            ARM,
            arm=config / 'arms' / 'kuka_kr5_sixx_r650.yaml',
            time_scale=0,
            noise=0.0,
            step=0.0,
        )
        asked = {
            'placements': config / 'locations' / 'kr5.yaml',
            'output': bag,
            'locations': '[3]',
            'spheres': '[1, 10]',
            'poses_per_sphere': each_sphere,
            'resume': 'true',
        }
        rng = np.random.default_rng(SEED)
        cut = False
        for number in range(KILLS):
            capture = graph.start(CAPTURE, **asked)
            killed_at = len(perfect.poses) + int(rng.integers(1, 25))
            end = time.monotonic() + 60
            if number % 3 == 2:  # at any moment, be it before the first pose
                end = time.monotonic() + rng.uniform(0.2, 3.0)
            while len(perfect.poses) < killed_at and time.monotonic() < end:
                perfect.executor.spin_once(timeout_sec=0.05)
            assert capture.poll() is None, capture.communicate()[1]
            time.sleep(rng.uniform(0.0, 0.02))
            capture.kill()
            said = capture.communicate()[0]
            for _ in range(20):  # what it had sent and nobody had read yet
                perfect.executor.spin_once(timeout_sec=0.01)
            assert not cut or 'missing: no end of the recording' in said or number % 3 == 2
            acknowledged = {stamp_of(pose.header) for pose in perfect.poses}
            if acknowledged:
                there = set(read_measurement(bag).poses.stamp.tolist())
                assert acknowledged <= there
                recover(bag, tmp_path / f'recovered_{number}')
                back = read_measurement(tmp_path / f'recovered_{number}').poses
                assert set(back.stamp.tolist()) == there
            cut = bool(acknowledged)
        before = read_measurement(bag).poses
        assert len(before) < 2 * each_sphere  # else there was nothing to resume
        capture = graph.start(CAPTURE, **asked)
        perfect.spin_while(capture)
        said, error = capture.communicate()
        assert capture.returncode == 0, error
        assert f'{len(before)} poses are there already' in said
        poses = read_measurement(bag).poses
        assert len(poses) == 2 * each_sphere
        assert [(poses.sphere == sphere).sum() for sphere in (1, 10)] == [each_sphere] * 2
        assert set(before.stamp.tolist()) < set(poses.stamp.tolist())
        apart = np.abs(poses.joints[:, None] - poses.joints[None]).max(axis=2)
        assert (apart[~np.eye(len(poses), dtype=bool)] > 2e-3).all()  # none twice
        list(read_messages(bag, cut_allowed=False))
        capture = graph.start(CAPTURE, **asked)
        perfect.spin_while(capture)
        assert f'complete with {2 * each_sphere} poses' in capture.communicate()[0]
    finally:
        perfect.close()
