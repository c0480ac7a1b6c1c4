# SPDX-License-Identifier: Apache-2.0
"""Poses that somebody takes by hand, and takes back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib_capture.recording import (
    HandGuidedRecord,
    HandGuidedRun,
    HandGuidedSession,
    PoseTaker,
    Recorder,
    TakeError,
    TakingSession,
    begun,
)
from calib_model.arrays import Array
from calib_model.bags import cdr, read_messages, read_poses
from calib_model.instruments import Arm, Gauge, PassiveProbe
from calib_model.kinematics import points
from calib_model.labelling import SphereFinder
from calib_model.pairing import ClockEstimate, HandGuidedSettings, JointSample
from calib_model.stamps import SECOND
from calib_model.topics import CAPTURE_POSES, CAPTURE_UNDONE, PROBING_POSE
from calib_model.transforms import RigidTransform

BALL = PassiveProbe('ball', RigidTransform(np.array([0.0, 0.01, 0.05]), np.zeros(3)))
BEGIN = 1_700_000_000 * SECOND


class Hand:
    """Leads the arm: joint states 50 times a second, in a time of its own."""

    def __init__(self, folder: Path, arm: Arm, gauge: Gauge, **more: object) -> None:
        self.now = 0.0
        self.announced: list[bytes] = []
        self.back: list[bytes] = []
        self.names = list(arm.joint_names)
        earlier = more.get('earlier', ())
        recorder = Recorder(folder, arm, BALL, gauge, self.announced.append, BEGIN, earlier=earlier)
        clocks = (lambda: self.now, lambda: BEGIN + round(self.now * SECOND))
        self.taker = PoseTaker(arm, BALL, recorder, self.back.append, *clocks)
        self.session = TakingSession(self.taker, recorder, *clocks, 3.0)

    def hold(self, joints: Array, seconds: float = 0.4, speed: float = 0.0) -> None:
        for _ in range(round(seconds * 50)):
            self.now += 0.02
            joints = joints + 0.02 * speed
            stamp = BEGIN + round(self.now * SECOND)
            raw = cdr.encode(cdr.joint_state(stamp, 'base', self.names, joints))
            self.session.take_joints(JointSample(stamp, joints), raw)


@pytest.fixture
def hand(tmp_path: Path, kr5: Arm, gauge: Gauge) -> Hand:
    return Hand(tmp_path / 'bag', kr5, gauge)


def postures(count: int) -> Array:
    return np.random.default_rng(count).uniform(-1.0, 1.0, (count, 6))


def test_each_take_is_a_pose_on_disk_without_a_spheres_number(hand: Hand, tmp_path: Path) -> None:
    wanted = postures(4)
    for number, joints in enumerate(wanted, start=1):
        hand.hold(joints)
        assert hand.taker.take().startswith(f'pose {number} taken')
        assert len(read_poses(tmp_path / 'bag')[1]) == number  # before the bag is closed
    with hand.session.recorder:
        hand.session.finish()
    poses = read_poses(tmp_path / 'bag')[1]
    assert np.array_equal(poses.joints, wanted)
    assert poses.untold.all()
    assert len(hand.announced) == 4


def test_what_is_taken_back_is_no_pose_any_more(hand: Hand, tmp_path: Path) -> None:
    wanted = postures(5)
    for joints in wanted:
        hand.hold(joints)
        hand.taker.take()
    assert hand.taker.undo() == 'pose 5 taken back, 4 left'
    assert hand.taker.undo() == 'pose 4 taken back, 3 left'
    hand.hold(wanted[4])
    assert hand.taker.take().startswith('pose 4 taken')
    assert hand.session.tally.line() == '4 poses taken by hand, 2 taken back'
    with hand.session.recorder:
        hand.session.finish()
    poses = read_poses(tmp_path / 'bag')[1]
    assert np.array_equal(poses.joints, wanted[[0, 1, 2, 4]])
    topics = [message.topic for message in read_messages(tmp_path / 'bag')]
    assert (topics.count(CAPTURE_POSES.name), topics.count(CAPTURE_UNDONE.name)) == (6, 2)
    back = [cdr.stamp_of(cdr.decode(PROBING_POSE, data)) for data in hand.back]
    assert not np.isin(back, poses.stamp).any()


def test_nothing_is_taken_of_an_arm_that_moves_or_is_silent(hand: Hand) -> None:
    with pytest.raises(TakeError, match='no joint states'):
        hand.taker.take()
    with pytest.raises(TakeError, match='nothing was taken'):
        hand.taker.undo()
    hand.hold(postures(1)[0], speed=0.4)
    with pytest.raises(TakeError, match=r'moves at 0\.40 rad/s'):
        hand.taker.take()
    hand.hold(postures(1)[0])
    hand.taker.take()
    with pytest.raises(TakeError, match='no joint state has come since'):
        hand.taker.take()
    hand.now += 1.0
    with pytest.raises(TakeError, match='no joint states'):
        hand.taker.take()
    assert hand.session.tally.taken == 1


def test_a_posture_taken_twice_is_told(hand: Hand) -> None:
    hand.hold(postures(1)[0])
    hand.taker.take()
    hand.hold(postures(1)[0] + 1e-3)
    assert 'stands as it did' in hand.taker.take()


def test_a_session_is_gone_on_with(hand: Hand, tmp_path: Path, kr5: Arm, gauge: Gauge) -> None:
    wanted = postures(3)
    for joints in wanted[:2]:
        hand.hold(joints)
        hand.taker.take()
    hand.session.recorder.close()
    there = begun(tmp_path / 'bag', kr5, BALL, gauge)
    assert there.taken == 2
    again = Hand(tmp_path / 'bag', kr5, gauge, earlier=there.files)
    again.now = 100.0
    again.hold(wanted[2])
    again.taker.take()
    again.session.recorder.close()
    assert np.array_equal(read_poses(tmp_path / 'bag')[1].joints, wanted)


def test_poses_can_be_taken_beside_those_along_the_way(
    tmp_path: Path, kr5: Arm, gauge: Gauge
) -> None:
    """Of a passive probe whose readings come: where a sphere is known it is named."""
    hand = Hand(tmp_path / 'bag', kr5, gauge)
    known, unknown = postures(2)
    ball = points(kr5, known[None], BALL.flange_T_probe.apply(BALL.center))[0]
    place = RigidTransform(ball - gauge.center(gauge.numbers[1]), np.zeros(3))
    finder = SphereFinder(kr5, BALL, gauge, {4: place}, gauge.numbers)
    run = HandGuidedRun(finder, HandGuidedSettings())
    clocks = (lambda: hand.now, lambda: BEGIN + round(hand.now * SECOND))
    recorder = hand.session.recorder
    taker = PoseTaker(kr5, BALL, recorder, hand.back.append, *clocks, run.sphere_at)
    hand.session = HandGuidedSession(
        run,
        ClockEstimate(kr5, BALL, gauge),
        recorder,
        HandGuidedRecord(HandGuidedSettings(), {4: place}),
        'base',
        *clocks,
        3.0,
        taker=taker,
    )
    for joints in (known, unknown, known + 0.3):
        hand.hold(joints)
        taker.take()
    taker.undo()
    with recorder:
        hand.session.finish()
    assert (run.tally.taken, run.tally.by_hand) == (2, 2)
    assert hand.session.remarks().startswith('2 poses taken by hand, 1 taken back')
    poses = read_poses(tmp_path / 'bag')[1]
    assert poses.location.tolist() == [4, 0]
    assert poses.sphere.tolist() == [gauge.numbers[1], 0]
