# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.motion.trajectory import Motion, Trajectory, TrajectoryError, checked_trajectory

pytestmark = pytest.mark.timeout(60)
NAMES = tuple(f'joint_a{i}' for i in range(1, 7))


def trajectory(seconds, positions):
    return Trajectory(np.array(seconds, dtype=float), np.array(positions, dtype=float))


def test_names_may_come_in_any_order(kr5):
    given = checked_trajectory(kr5, NAMES[::-1], [1.0], [[6.0, 0.5, 0.4, 0.3, 0.2, 0.1]])
    assert given.positions.tolist() == [[0.1, 0.2, 0.3, 0.4, 0.5, 6.0]]


@pytest.mark.parametrize(
    ('names', 'seconds', 'positions', 'said'),
    [
        (NAMES[:5], [1.0], [[0.0] * 5], 'expected joint_a1, joint_a2'),
        ((*NAMES[:5], 'joint_b'), [1.0], [[0.0] * 6], 'joint_b'),
        ((*NAMES[:5], 'joint_a1'), [1.0], [[0.0] * 6], 'expected joint_a1'),
        (NAMES, [1.0], [[0.0] * 5], 'point 1: expected 6 positions, got 5'),
        (NAMES, [1.0, 2.0], [[0.0] * 6, [np.nan] * 6], 'point 2 has a position that is no number'),
        (NAMES, [1.0, 1.0], [[0.0] * 6] * 2, 'point 2 is not later than the one before'),
        (NAMES, [-1.0, 1.0], [[0.0] * 6] * 2, 'point 1 is due before the start'),
        (NAMES, [1.0], [[0.0, 3.0] + [0.0] * 4], 'takes joint_a2 out of its limits'),
    ],
)
def test_what_cannot_be_followed_is_refused_with_a_line(kr5, names, seconds, positions, said):
    with pytest.raises(TrajectoryError, match=said):
        checked_trajectory(kr5, names, seconds, positions)


def test_points_are_reached_when_they_are_due_and_in_straight_lines():
    motion = Motion(np.zeros(2), trajectory([1.0, 3.0], [[1.0, -1.0], [2.0, 0.0]]), np.full(2, 10))
    assert motion.duration == 3.0
    due = {0.0: [0, 0], 0.5: [0.5, -0.5], 1.0: [1, -1], 2.0: [1.5, -0.5]}
    for seconds, expected in due.items():
        assert np.allclose(motion.at(seconds)[0], expected)
    assert np.allclose(motion.at(0.5)[1], [1.0, -1.0])
    assert np.allclose(motion.at(9.0)[0], [2, 0])
    assert np.allclose(motion.at(9.0)[1], 0)


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), points=st.integers(1, 6))
def test_no_joint_is_ever_faster_than_it_may_be(seed, points):
    rng = np.random.default_rng(seed)
    velocity = rng.uniform(0.2, 3.0, 3)
    asked = trajectory(np.cumsum(rng.uniform(1e-3, 2.0, points)), rng.uniform(-3, 3, (points, 3)))
    motion = Motion(rng.uniform(-3, 3, 3), asked, velocity)
    times = np.linspace(-0.1, motion.duration + 0.1, 400)
    q = np.array([motion.at(t)[0] for t in times])
    assert (np.abs(np.diff(q, axis=0)) <= velocity * np.diff(times)[:, None] * (1 + 1e-9)).all()
    assert np.array_equal(motion.at(motion.duration)[0], asked.positions[-1])
    assert motion.duration >= asked.seconds[-1] - 1e-12
    speeds = np.array([motion.at(t)[1] for t in times])
    assert (np.abs(speeds) <= velocity * (1 + 1e-9)).all()


def test_time_is_stretched_only_where_a_joint_is_too_slow():
    asked = trajectory([0.1, 0.6], [[1.0], [1.0]])
    motion = Motion(np.zeros(1), asked, np.ones(1))
    assert np.allclose(motion.seconds, [0.0, 1.0, 1.5])


def test_stepping_looks_at_both_ends_and_the_middle_of_every_rest():
    asked = trajectory([1.0, 1.06, 1.2, 1.26], [[1.0], [1.0], [2.0], [2.0]])
    motion = Motion(np.zeros(1), asked, np.full(1, 100.0))
    instants = motion.instants()
    assert np.allclose(instants, [0, 1.0, 1.03, 1.06, 1.2, 1.23, 1.26])
    assert np.allclose([motion.at(t)[1] for t in instants[1:]], 0)  # stops show as stops


def test_stepping_passes_by_points_without_a_rest_but_sees_a_way_there_and_back():
    asked = trajectory([1.0, 1.5, 2.0, 2.08, 2.5, 3.0], [[1.0], [3.0], [2.0], [2.0], [2.5], [2.0]])
    motion = Motion(np.zeros(1), asked, np.full(1, 100.0))
    assert np.allclose(motion.instants(), [0, 2.0, 2.04, 2.08, 2.5, 3.0])


def test_a_long_rest_has_no_gap_that_a_probe_would_not_be_read_across():
    motion = Motion(np.zeros(1), trajectory([1.0, 3.0], [[1.0], [1.0]]), np.full(1, 100.0))
    instants = motion.instants()
    assert np.diff(instants[instants >= 1.0]).max() < 0.1


def test_resting_stays():
    motion = Motion.resting(np.array([1.0, 2.0]))
    assert motion.duration == 0.0
    assert np.array_equal(motion.at(5.0)[0], [1.0, 2.0])
    assert np.array_equal(motion.at(0.0)[1], [0.0, 0.0])
