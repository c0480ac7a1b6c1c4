# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_capture.motion import (
    InterpolatedMotion,
    Leg,
    MotionLimits,
    MotionState,
    StrictController,
    Trajectory,
    TrajectoryError,
    checked_trajectory,
    motion_limits,
    stop,
)
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
NAMES = tuple(f'joint_a{i}' for i in range(1, 7))
ZEROS = [0.0] * 6


def trajectory(seconds, positions, velocities=None, accelerations=None):
    fields = (positions, velocities, accelerations)
    return Trajectory(
        np.array(seconds, dtype=float),
        *(None if rows is None else np.array(rows, dtype=float) for rows in fields),
    )


def limits(n=1, velocity=2.0, acceleration=8.0, jerk=60.0):
    reach = np.tile([-50.0, 50.0], (n, 1))
    return MotionLimits(reach, *(np.full(n, each) for each in (velocity, acceleration, jerk)))


def sampled(motion, step=1e-3):
    return motion.states_at(np.arange(0.0, motion.duration, step))


def resting(at):
    return MotionState.resting(np.array(at, dtype=float))


def test_names_come_in_any_order(kr5):
    found = checked_trajectory(kr5, NAMES[::-1], [1.0], [[6.0, 0.5, 0.4, 0.3, 0.2, 0.1]])
    assert found.positions.tolist() == [[0.1, 0.2, 0.3, 0.4, 0.5, 6.0]]


@pytest.mark.parametrize(
    ('names', 'seconds', 'positions', 'velocities', 'said'),
    [
        (NAMES, [], [], [], 'empty trajectory'),
        (NAMES[:5], [1.0], [ZEROS[:5]], [], 'expected joint_a1, joint_a2'),
        ((*NAMES[:5], 'joint_b'), [1.0], [ZEROS], [], 'joint_b'),
        (NAMES, [1.0], [ZEROS[:5]], [], 'point 1: expected 6 positions, got 5'),
        (NAMES, [1.0, 2.0], [ZEROS, [np.nan] * 6], [], 'point 2 has positions that are no num'),
        (NAMES, [1.0, 1.0], [ZEROS] * 2, [], 'point 2 is not later than the one before'),
        (NAMES, [-1.0, 1.0], [ZEROS] * 2, [], 'point 1 is due before the start'),
        (NAMES, [1.0], [ZEROS], [[0.1] * 6], 'velocity of the last trajectory point is not zero'),
        (NAMES, [1.0], [ZEROS], [[0.0] * 3], 'point 1: expected 6 velocities, got 3'),
    ],
)
def test_what_the_controller_rejects_is_rejected(kr5, names, seconds, positions, velocities, said):
    with pytest.raises(TrajectoryError, match=said):
        checked_trajectory(kr5, names, seconds, positions, velocities)


def test_interpolation_follows_the_fields_that_are_given():
    start, way = resting([0.0]), ([1.0], [[1.0]])
    linear = InterpolatedMotion(start, trajectory(*way))
    cubic = InterpolatedMotion(start, trajectory(*way, [[0.0]]))
    quintic = InterpolatedMotion(start, trajectory(*way, [[0.0]], [[0.0]]))
    at = [float(each.at(0.25).position[0]) for each in (linear, cubic, quintic)]
    assert at == pytest.approx([0.25, 3 / 16 - 2 / 64, 10 / 64 - 15 / 256 + 6 / 1024])
    assert all(float(each.at(9.0).position[0]) == 1.0 for each in (linear, cubic, quintic))


@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_legs_keep_all_limits_between_points_and_stay_on_their_straight_lines(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    allowed = limits(n, *rng.uniform([0.1, 1.0, 10.0], [4.0, 20.0, 300.0]))
    here = rng.uniform(-3, 3, n)
    corners = [here]
    leg = Leg(here, allowed)
    for size in 10 ** rng.uniform(-5, 0.5, 5):
        corners.append(corners[-1] + rng.normal(0, size, n))
        leg.to(corners[-1])
        leg.rest(0.05)
    motion = InterpolatedMotion(resting(here), leg.trajectory())
    assert motion.first_fault(allowed, tuple('abcdefgh'[:n])) is None
    q, v, a = sampled(motion)
    assert (np.abs(v) <= allowed.velocity * (1 + 1e-6)).all()
    assert (np.abs(a) <= allowed.acceleration * (1 + 1e-6)).all()
    assert (np.abs(np.diff(a, axis=0)) <= 1e-3 * allowed.jerk * (1 + 1e-3) + 1e-9).all()
    assert not v[0].any()
    assert np.abs(motion.at(motion.duration).position - corners[-1]).max() < 1e-12
    off = np.full(len(q), np.inf)
    for one, other in zip(corners, corners[1:], strict=False):
        way = other - one
        part = np.clip((q - one) @ way / (way @ way), 0, 1)
        off = np.minimum(off, np.abs(one + part[:, None] * way - q).max(axis=1))
    assert off.max() < 1e-9


@pytest.mark.parametrize(
    ('fields', 'said'),
    [
        ({'velocities': None, 'accelerations': None}, 'in a jump of velocity'),
        ({'accelerations': None}, 'in a jump of acceleration'),
        ({'seconds': [0.4]}, 'rad/s, limit'),
        ({'seconds': [0.9], 'positions': [[0.9]]}, 'rad/s^3, limit'),
        ({'seconds': [9.0], 'positions': [[50.1]]}, 'beyond the position limits'),
    ],
)
def test_the_first_limit_that_is_passed_is_named(fields, said):
    asked = {'seconds': [2.0], 'positions': [[1.0]], 'velocities': [[0.0]]}
    asked |= {'accelerations': [[0.0]], **fields}
    motion = InterpolatedMotion(resting([0.0]), trajectory(**asked))
    fast = limits(1, 2.0, 1e4, 1e5) if 'rad/s, limit' in said else limits(velocity=60.0)
    fault = motion.first_fault(fast, ('a',))
    assert fault is not None
    assert said in fault.words


def test_after_a_fault_the_arm_stands_and_takes_nothing(kr5):
    told = []
    controller = StrictController(kr5, motion_limits(kr5), 0, told.append)
    good = trajectory([1.0, 5.0], [ZEROS, [0.1] * 6], [ZEROS] * 2, [ZEROS] * 2)
    controller.follow(trajectory([1.0, 1.5], [ZEROS, [0.5] * 6]), 0)
    assert not controller.at(SECOND // 2).velocity.any()
    assert not told
    state = controller.at(3 * SECOND)
    assert not state.position.any()
    assert told[0].startswith('FAULT joint_a')
    with pytest.raises(TrajectoryError, match='the arm has failed'):
        controller.follow(good, 4 * SECOND)


def test_a_trajectory_that_ends_in_the_past_is_rejected_and_one_that_began_there_is_joined(kr5):
    controller = StrictController(kr5, motion_limits(kr5), 0, print)
    leg = Leg(np.zeros(6), motion_limits(kr5))
    leg.to(np.full(6, 0.4))
    way = leg.trajectory()
    with pytest.raises(TrajectoryError, match='ends in the past'):
        controller.follow(way, 100 * SECOND, SECOND)
    controller.follow(way, 10 * SECOND, 10 * SECOND - SECOND // 20)
    there = controller.at(10 * SECOND + SECOND // 2).position
    assert np.allclose(there, InterpolatedMotion(resting(ZEROS), way).at(0.55).position)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_stop_keeps_the_limits_and_the_leg_whenever_it_arrives(seed):
    rng = np.random.default_rng(seed)
    allowed, here = limits(3), np.zeros(3)
    leg = Leg(here, allowed.share(0.5, 0.85, 0.85))
    corners = [here, *rng.uniform(-2, 2, (3, 3))]
    for corner in corners[1:]:
        leg.to(corner)
        leg.rest(0.5)
    motion = InterpolatedMotion(resting(here), leg.trajectory())
    asked = rng.uniform(0, motion.duration)
    for late in np.arange(asked, asked + 1.0, 0.02):
        found = stop(motion, late, late + 0.06, allowed)
        if found is not None:
            break
    assert found is not None
    state = motion.at(late + rng.uniform(0, 0.06))
    stopping = InterpolatedMotion(state, found)
    assert stopping.first_fault(allowed, ('a', 'b', 'c')) is None
    assert found.duration < 1.0
    passed = motion.leg(late + 0.03)
    way = passed[1] - passed[0]
    if np.abs(way).max() > 1e-3:
        gone = [(each - passed[0]) @ way / (way @ way) for each in sampled(stopping).position]
        assert max(gone) <= 1 + 3e-4 / np.abs(way).max()


def test_stepping_looks_at_both_ends_and_the_middle_of_every_rest():
    asked = trajectory([1.0, 1.06, 1.2, 1.26], [[1.0], [1.0], [2.0], [2.0]])
    instants = InterpolatedMotion(resting([0.0]), asked).instants()
    assert np.allclose(instants, [0, 1.0, 1.03, 1.06, 1.2, 1.23, 1.26])


def test_stepping_passes_by_points_without_a_rest_but_sees_a_way_there_and_back():
    asked = trajectory([1.0, 1.5, 2.0, 2.08, 2.5, 3.0], [[1.0], [3.0], [2.0], [2.0], [2.5], [2.0]])
    instants = InterpolatedMotion(resting([0.0]), asked).instants()
    assert np.allclose(instants, [0, 2.0, 2.04, 2.08, 2.5, 3.0])


def test_a_long_rest_has_no_gap_that_a_probe_would_not_be_read_across():
    motion = InterpolatedMotion(resting([0.0]), trajectory([1.0, 3.0], [[1.0], [1.0]]))
    instants = motion.instants()
    assert np.diff(instants[instants >= 1.0]).max() < 0.1
