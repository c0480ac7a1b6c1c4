# SPDX-License-Identifier: Apache-2.0
"""Joints between joint states: near to the truth of a moving arm, decided by four states alone."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.pairing.interpolation import between, interpolated
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
T0 = 1_700_000_000 * SECOND


def ns(seconds):
    return T0 + np.round(np.asarray(seconds) * SECOND).astype(np.int64)


def way(seconds):
    return np.stack([np.sin(2 * seconds), 0.5 * np.cos(3 * seconds)], axis=1)


def at(t, q, seconds, max_gap=0.1):
    return interpolated(ns(t), q, ns(np.atleast_1d(seconds)), max_gap)


@pytest.mark.parametrize(('rate', 'off'), [(250, 2e-8), (100, 3e-7), (30, 1e-5)])
def test_a_moving_arm_is_where_it_was(rate, off):
    t = np.arange(0, 3, 1 / rate)
    seconds = np.random.default_rng(1).uniform(t[1], t[-2], 500)
    found = at(t, way(t), seconds)
    assert found.known.all()
    assert np.abs(found.joints - way(seconds)).max() < off
    line = np.transpose([np.interp(seconds, t, q) for q in way(t).T])
    assert np.abs(line - way(seconds)).max() > 30 * off


def test_a_parabola_is_followed_exactly_also_at_the_ends_and_across_uneven_gaps():
    t = np.cumsum([0, 4, 4, 8, 4, 6, 12, 3.5]) * 1e-3
    parabola = lambda seconds: np.stack([3 * seconds**2, 1 - seconds], axis=1)  # noqa: E731
    seconds = np.linspace(t[0], t[-1], 200)
    found = at(t, parabola(t), seconds)
    assert found.known.all()
    # stamps are whole ns
    assert np.abs(found.joints - parabola(seconds)).max() < 2e-9


def test_a_joint_state_is_itself_whatever_is_beside_it():
    t = np.array([0.0, 0.05, 5.0])
    q = way(t)
    found = at(t, q, t, max_gap=0.02)
    assert np.array_equal(found.joints, q)
    assert found.gap.tolist() == [0, 0, 0]


def test_nothing_is_known_outside_and_across_a_longer_gap():
    t = np.array([0.0, 0.05, 0.5, 0.55])
    found = at(t, way(t), [-0.1, 0.02, 0.3, 0.52, 0.6])
    assert found.known.tolist() == [False, True, False, True, False]
    assert np.isnan(found.joints[[0, 2, 4]]).all()
    assert found.gap.tolist() == [0, SECOND // 20, 0, SECOND // 20, 0]
    # a state beyond the gap says nothing of the way on this side: without another it is a line
    assert np.allclose(found.joints[1], 0.6 * way(t)[0] + 0.4 * way(t)[1], atol=1e-12)


def test_two_states_stamped_almost_at_once_do_not_throw_the_arm():
    """Their difference is noise; as a slope it would be tens of radians a second."""
    t = np.array([0.0, 0.0099, 0.01, 0.02, 0.03])
    q = np.array([[0.0], [0.0], [1e-4], [1e-4], [1e-4]])
    found = at(t, q, np.linspace(0.0, 0.03, 100))
    assert found.joints.min() > -1e-4 / 2
    assert found.joints.max() < 1.5e-4


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 30))
def test_four_states_decide_bit_for_bit(seed, count):
    """What live pairing sees of a stream gives what the whole stream gives."""
    rng = np.random.default_rng(seed)
    stamp = T0 + np.cumsum(rng.integers(1, 30_000_000, count))
    joints = rng.normal(size=(count, 6))
    asked = np.sort(rng.integers(stamp[0] - 10**6, stamp[-1] + 10**6, 50))
    whole = interpolated(stamp, joints, asked, 0.02)
    for row, each in enumerate(asked):
        before = int(np.searchsorted(stamp, each, side='right')) - 1
        near = slice(max(0, before - 1), before + 3)
        found = interpolated(stamp[near], joints[near], np.array([each]), 0.02)
        assert found.known[0] == whole.known[row]
        assert np.array_equal(found.joints[0], whole.joints[row], equal_nan=True)


@given(st.integers(1, 10**9), st.integers(-(10**9), 2 * 10**9), st.integers(0, 10**9))
def test_of_two_states_alone_it_is_the_line_and_the_same_as_of_many(gap, after, longest):
    first, joints = 1_700_000_000 * SECOND, np.array([[0.1, -2.0], [0.3, -2.5]])
    stamps, instant = np.array([first, first + gap]), first + after
    max_gap = longest / SECOND
    known = interpolated(stamps, joints, np.array([instant]), max_gap).joints[0]
    alone = between(first, joints[0], first + gap, joints[1], instant, max_gap)
    assert np.array_equal(alone, known, equal_nan=True)
