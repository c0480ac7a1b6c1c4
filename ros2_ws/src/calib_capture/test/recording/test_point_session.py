# SPDX-License-Identifier: Apache-2.0
"""A tracker's points get the posture in which they were measured, or none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_capture.recording import PointSession, TrackedPoint
from calib_model.bags import read_points
from calib_model.pairing import JointSample
from calib_model.stamps import SECOND
from calib_model.tracking import StandingSettings

RATE = 0.01
BEGIN = 1_700_000_000 * SECOND


def at(seconds: float) -> int:
    return BEGIN + round(seconds * SECOND)


class Bench:
    """An arm whose encoders are read every 10 ms, and what the session says."""

    def __init__(self, folder, arm, received=False) -> None:
        self.now, self.said, self.arm = 0.0, [], arm
        self.bag = folder / 'bag'
        self.session = PointSession(
            self.bag,
            arm,
            StandingSettings(),
            received,
            self.said.append,
            lambda: self.now,
            lambda: at(self.now),
        )

    def stand(self, joints, seconds: float, noise: float = 0.0) -> None:
        generator = np.random.default_rng(1)
        for _ in range(round(seconds / RATE)):
            self.now += RATE
            off = noise * generator.uniform(-1, 1, self.arm.n)
            self.session.see(JointSample(at(self.now), np.asarray(joints) + off))

    def move(self, start, end, seconds: float) -> None:
        for share in np.linspace(0, 1, round(seconds / RATE)):
            self.stand((1 - share) * np.asarray(start) + share * np.asarray(end), RATE)

    def seen(self, when: float, target: str = '1', **more) -> None:
        given = {'station': 1, 'orientation': np.zeros(4), 'sigma': 0.0, **more}
        point = TrackedPoint(at(when), target, position=np.array([0.1, 0.2, 0.3]), **given)
        self.session.take(point)

    def wait(self, seconds: float) -> None:
        self.now += seconds
        self.session.tick()


@pytest.fixture
def bench(tmp_path, kr5) -> Bench:
    return Bench(tmp_path, kr5)


HERE, THERE = np.linspace(-0.5, 0.5, 6), np.linspace(0.6, -0.3, 6)


def test_points_get_the_mean_posture_of_the_stop_they_were_measured_in(bench):
    bench.stand(HERE, 1.0, noise=1e-4)
    bench.seen(0.95)
    assert bench.said == []  # the states after it are to come
    bench.stand(HERE, 0.3, noise=1e-4)
    bench.move(HERE, THERE, 1.0)
    bench.stand(THERE, 1.0)
    # said late, of a moment long past
    bench.seen(1.0, 'nest')
    bench.seen(3.2, orientation=np.array([0.0, 0.6, 0.0, 0.8]), sigma=0.0)
    bench.stand(THERE, 0.2)
    bench.session.close()
    points = read_points(bench.bag).points
    assert points.target.tolist() == ['1', 'nest', '1']
    assert points.stamp.tolist() == [at(0.95), at(1.0), at(3.2)]
    assert points.oriented.tolist() == [False, False, True]
    np.testing.assert_allclose(points.joints[:2], [HERE, HERE], atol=5e-5)
    np.testing.assert_allclose(points.joints[2], THERE, atol=1e-12)
    assert bench.session.tally.line() == '3 points of 2 targets from 1 station'


@pytest.mark.parametrize('moment', [1.2, 1.5, 1.95, 2.2])
def test_a_point_measured_while_the_arm_moves_or_swings_is_refused(bench, moment):
    bench.stand(HERE, 1.0)
    bench.move(HERE, THERE, 1.0)
    bench.stand(THERE, 1.0)
    bench.seen(moment)
    assert bench.said == ["refused: target '1', station 1: the arm moves"]


def test_points_without_joint_states_about_them_are_refused(bench):
    bench.seen(0.0)
    bench.stand(HERE, 1.0)
    bench.seen(0.1)  # the states began then
    bench.seen(1.0)
    bench.wait(0.5)
    assert len(bench.said) == 2
    bench.wait(0.6)  # none has come after it
    bench.stand(HERE, 1.0)  # 1.1 s later
    bench.seen(1.05)
    assert [line.rpartition(': ')[2] for line in bench.said] == ['joint states are missing'] * 4


@pytest.mark.parametrize(
    ('when', 'words'), [(-BEGIN / SECOND, 'it has no stamp'), (60.0, 'its stamp is far from')]
)
def test_stamps_of_another_clock_are_refused_unless_receipt_counts(tmp_path, kr5, when, words):
    by_header, by_receipt = Bench(tmp_path / 'a', kr5), Bench(tmp_path / 'b', kr5, received=True)
    for bench in (by_header, by_receipt):
        bench.stand(HERE, 1.0)
        bench.seen(when)
        bench.stand(HERE, 0.5)
    assert words in by_header.said[0]
    assert 'stamps:=received' in by_header.said[0]
    assert by_receipt.said == ["point 1 taken: target '1', station 1"]


@pytest.mark.parametrize(
    ('more', 'words'),
    [
        ({'sigma': 1e-5}, 'has no sigma, while others have one'),
        ({'station': 0}, 'no station number'),
        ({'orientation': np.array([0.0, 0.0, 0.0, 2.0])}, 'no unit quaternion'),
        ({'target': ''}, 'names no target'),
        ({'joints': np.zeros(5)}, 'has 5 joint positions'),
    ],
)
def test_what_no_identification_would_take_is_refused_and_the_rest_kept(bench, more, words):
    bench.stand(HERE, 1.0)
    bench.seen(0.8)
    bench.stand(HERE, 0.2)
    bench.seen(0.9, **{'target': '2', **more})
    bench.stand(HERE, 0.2)
    bench.session.close()
    assert words in bench.said[1]
    assert len(read_points(bench.bag).points) == 1


def test_a_point_with_its_own_joints_is_taken_as_it_is_and_once(bench):
    for _ in range(2):
        bench.seen(3.0, joints=THERE)
    assert bench.said[1].endswith('it came before')
    bench.session.close()
    np.testing.assert_array_equal(read_points(bench.bag).points.joints, [THERE])


def test_a_clock_that_is_set_back_begins_anew(bench):
    bench.stand(HERE, 1.0)
    bench.now -= 3600.0
    bench.stand(THERE, 1.0)
    bench.seen(-3599.0 + 0.7)
    bench.session.close()
    np.testing.assert_allclose(read_points(bench.bag).points.joints, [THERE], atol=1e-12)


def test_what_was_taken_is_on_disk_at_once(bench):
    bench.seen(1.0, joints=HERE)
    size = sum(file.stat().st_size for file in bench.bag.iterdir())
    bench.seen(2.0, joints=THERE)
    assert sum(file.stat().st_size for file in bench.bag.iterdir()) > size
    assert replace(bench.session._first, stamp=0).target == '1'
