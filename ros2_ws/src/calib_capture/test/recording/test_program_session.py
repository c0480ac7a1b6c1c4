# SPDX-License-Identifier: Apache-2.0
"""A session of a program from streams to bag, with an arm and a probe that are a few lines."""

import numpy as np
import pytest

from calib_capture.measuring import MeasuringRun, RunSettings
from calib_capture.motion import InterpolatedMotion
from calib_capture.program import PlannedPose, Program, SpherePlan
from calib_capture.recording.program_session import ProgramSession
from calib_capture.recording.recorder import Recorder
from calib_model.bags import cdr, read_measurement, read_messages
from calib_model.errors import BagError
from calib_model.pairing import JointSample, Pairing, Reading, SteadySettings
from calib_model.stamps import SECOND
from calib_model.topics import CAPTURE_POSES

pytestmark = pytest.mark.timeout(60)
SETTINGS = RunSettings(batch=3, answer_timeout=1.0, give_up=5.0)


@pytest.fixture
def program():
    """Seven postures in a row, 0.1 rad apart, and two spares on the other side."""

    def pose(i):
        return PlannedPose(1, 1, np.full(6, 0.1 * i), np.zeros(3))

    poses = tuple(pose(i) for i in range(1, 8))
    return Program((SpherePlan(1, 1, poses, (pose(-1), pose(-2)), 7, 0),))


class Simulated:
    """Arm and probe in one: goes where it is told and reads as it is told to."""

    def __init__(self, kr5, folder, program, status=lambda joints: 0):
        self.kr5 = kr5
        self.status = status
        self.trajectories = []
        self.announced = []
        self.on_disk = []
        self.now = 0
        self.folder = folder
        self.program = program

    def session(self, probe, gauge):
        recorder = Recorder(self.folder, self.kr5, probe, gauge, self.announce, 1)
        run = MeasuringRun(self.kr5, self.program, SETTINGS, 0.0)
        pairing = Pairing(SteadySettings())
        clock, wall = (lambda: self.now / SECOND), (lambda: self.now)
        return ProgramSession(
            run, pairing, recorder, 'base_link', self.trajectories.append, clock, wall
        )

    def announce(self, data):
        self.announced.append(data)
        messages = read_messages(self.folder, {CAPTURE_POSES.name})
        self.on_disk.append([message.data for message in messages])

    def live(self, session, seconds):
        """Let time pass; every trajectory is followed from where the arm then is."""
        motion, began = InterpolatedMotion.resting(np.zeros(6)), 0
        for _ in range(round(seconds / 0.01)):
            self.now += SECOND // 100
            if self.trajectories:
                here = motion.at((self.now - began) / SECOND)
                motion = InterpolatedMotion(here, self.trajectories.pop())
                began = self.now
            q = motion.at((self.now - began) / SECOND)[0]
            raw = cdr.encode(cdr.joint_state(self.now, 'base', list(self.kr5.joint_names), q))
            session.take_joints(JointSample(self.now, q), raw)
            status = (self.status(q), 0, 0)
            raw = cdr.encode(cdr.displacements(self.now, 'probe', np.zeros(3), np.array(status)))
            session.take_reading(Reading(self.now, np.zeros(3), status), raw)
            session.tick()
            if session.finished:
                return


def test_a_session_takes_every_pose_into_a_bag_that_reads_back(
    kr5, probe, gauge, tmp_path, program
):
    simulated = Simulated(kr5, tmp_path / 'bag', program)
    session = simulated.session(probe, gauge)
    with session.recorder:
        simulated.live(session, 40.0)
    assert session.finished
    measured = read_measurement(tmp_path / 'bag')
    # where the arm was when it counted as still: it comes to rest smoothly
    assert np.allclose(measured.poses.joints, [pose.joints for pose in program.poses], atol=2e-5)
    assert measured.arm == kr5
    assert measured.gauge == gauge
    topics = {message.topic for message in read_messages(tmp_path / 'bag')}
    assert {'/joint_states', '/probe/displacements', '/capture/poses'} < topics


def test_a_pose_is_announced_when_it_is_on_disk(kr5, probe, gauge, tmp_path, program):
    simulated = Simulated(kr5, tmp_path / 'bag', program)
    session = simulated.session(probe, gauge)
    with session.recorder:
        simulated.live(session, 40.0)
    assert len(simulated.announced) == len(program.poses)
    for data, on_disk in zip(simulated.announced, simulated.on_disk, strict=True):
        assert data in on_disk


def test_pairing_redone_from_the_bag_gives_the_same_poses(kr5, probe, gauge, tmp_path, program):
    simulated = Simulated(kr5, tmp_path / 'bag', program)
    session = simulated.session(probe, gauge)
    with session.recorder:
        simulated.live(session, 40.0)
    pairing, redone = Pairing(SteadySettings()), []
    for message in read_messages(tmp_path / 'bag', {'/joint_states', '/probe/displacements'}):
        content = cdr.decode(message.type, message.data)
        stamp = cdr.stamp_of(content)
        if message.topic == '/joint_states':
            redone += pairing.add_joints(JointSample(stamp, content.position))
        else:
            reading = Reading(stamp, content.displacement, tuple(content.status))
            redone += pairing.add_reading(reading)
    poses = read_measurement(tmp_path / 'bag').poses
    taken = [pose for pose in redone if pose.stamp in poses.stamp]
    assert np.array_equal([pose.joints for pose in taken], poses.joints)
    assert np.array_equal([pose.displacement for pose in taken], poses.displacement)


def test_a_pose_beyond_the_styli_is_replaced_by_a_spare(kr5, probe, gauge, tmp_path, program):
    beyond = program.poses[2].joints
    simulated = Simulated(
        kr5, tmp_path / 'bag', program, lambda q: 2 if np.allclose(q, beyond, atol=1e-3) else 0
    )
    session = simulated.session(probe, gauge)
    with session.recorder:
        simulated.live(session, 60.0)
    assert session.finished
    joints = read_measurement(tmp_path / 'bag').poses.joints
    assert len(joints) == 7
    assert not any(np.allclose(q, beyond, atol=2e-5) for q in joints)
    assert any(np.allclose(q, program.spheres[0].spares[0].joints, atol=2e-5) for q in joints)


def test_a_bag_is_never_overwritten(kr5, probe, gauge, tmp_path, program):
    (tmp_path / 'bag').mkdir()
    with pytest.raises(BagError, match='exists already'):
        Simulated(kr5, tmp_path / 'bag', program).session(probe, gauge)
