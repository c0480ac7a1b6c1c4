# SPDX-License-Identifier: Apache-2.0
"""What recorded streams suffer from, seen and mended in arrays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calib_model.errors import DataError
from calib_model.stamps import SECOND
from calib_model.streams import Part, freshness, put_together, rival, tell_no_time, unwrapped

pytestmark = pytest.mark.timeout(60)
BEGIN = 1_733_000_000 * SECOND


def stamps(count, rate, begin=BEGIN):
    return begin + np.arange(count) * round(SECOND / rate)


def way(stamp, speed=0.4):
    """Joints (M, 3), rad, of an arm that is led along smoothly."""
    t = (stamp - stamp[0])[:, None] / SECOND
    return np.sin(speed * t * [1.0, 0.7, 0.3]) * [1.0, 2.0, 0.5]


def test_stamps_of_headers_that_tell_the_time_are_left_alone():
    logged = stamps(2000, 250)
    values = way(logged)
    rng = np.random.default_rng(3)
    for header in (
        logged - 2_000_000,
        logged - 31 * 86400 * SECOND,
        (logged - logged[0]) // 4 + 1,  # played back slowly
        (logged - logged[0]) * 30 + 1,  # simulated faster than the clock
        logged + rng.integers(-9_000_000, 9_000_000, len(logged)),
        np.concatenate([logged[:900], logged[900:] - 7 * SECOND]),  # a clock that is set once
        np.repeat(logged[::2], 2),  # recorded twice
    ):
        assert tell_no_time(header, logged, np.repeat(values[::2], 2, axis=0)) == ''
    old = np.repeat(logged[::50], 50)
    assert tell_no_time(old, logged, np.repeat(values[::50], 50, axis=0)) == ''


@pytest.mark.parametrize(
    ('header', 'said'),
    [
        (lambda t: 0 * t, 'all 0'),
        (lambda t: 0 * t + 77, 'go on by 0 s in 11.'),
        (lambda t: np.arange(len(t)), 'go on by'),
        (lambda t: np.random.default_rng(1).integers(0, 4 * 10**18, len(t)), 'jump back'),
        (lambda t: t // SECOND * SECOND, 'are the same for'),
    ],
)
def test_stamps_that_tell_no_time_are_seen_with_the_reason(header, said):
    logged = stamps(3000, 260)
    assert said in tell_no_time(header(logged), logged, way(logged))


@given(
    turns=st.floats(-20, 20),
    low=st.sampled_from([-np.pi, 0.0, -1.0]),
    noise=st.floats(0, 1e-5),
)
def test_an_encoder_that_wraps_goes_on_and_is_counted_as_it_counts(turns, low, noise):
    rng = np.random.default_rng(7)
    true = np.linspace(0.3, 0.3 + turns, 400)[:, None] + noise * rng.standard_normal((400, 1))
    shown = low + np.mod(true - low, 2 * np.pi)
    found, about = unwrapped(shown)
    assert np.abs(np.diff(found, axis=0)).max() < 0.2
    assert np.abs(np.mod(found - true + 1, 2 * np.pi) - 1).max() < 1e-9
    back = about.as_counted(found)
    assert np.abs(np.mod(back - shown + 1, 2 * np.pi) - 1).max() < 1e-9
    assert back.min() >= shown.min() - 1e-9
    assert (about.jumps[0] > 0) == (np.abs(np.diff(shown, axis=0)).max() > 5)


def test_joints_that_go_beyond_a_turn_are_left_as_they_are():
    joints = np.linspace(-5, 5, 300)[:, None]
    assert unwrapped(joints)[0] is joints


@pytest.mark.parametrize(('fresh_rate', 'sent'), [(8, 200), (31, 125)])
def test_positions_that_repeat_are_told_by_their_rate_and_left_out(fresh_rate, sent):
    true = stamps(4000, sent)
    period = round(SECOND / fresh_rate)
    asked = BEGIN + (true - BEGIN) // period * period
    joints = way(asked)
    found = freshness(true, joints)
    assert found.repeats
    assert 1 / found.every == pytest.approx(fresh_rate, rel=0.15)
    assert f'new {1 / found.every:.1f} times a second ({sent} are sent' in found.rate()
    kept = true[found.sound]
    late = kept - (BEGIN + (kept - BEGIN) // period * period)
    assert late.max() <= SECOND / sent + 1


def test_an_arm_that_stands_repeats_rightly():
    t = stamps(5000, 100)
    seconds = (t - BEGIN) / SECOND
    moved = np.clip(seconds % 10, 0, 2) / 2 + seconds // 10  # two seconds of way, eight of rest
    found = freshness(t, np.column_stack([moved, -moved]))
    assert found.sound.all() and not found.repeats


def test_a_driver_that_hangs_is_seen_where_the_arm_then_jumps():
    t = stamps(6000, 250)
    joints = way(t)
    joints[2500:3100] = joints[2500]
    found = freshness(t, joints)
    assert [row for row, _ in found.hung] == [2500]
    assert found.hung[0][1] == pytest.approx(599 / 250)
    assert not found.sound[2501:3100].any()
    assert found.sound[:2501].all() and found.sound[3100:].all()


def test_a_second_publisher_that_stands_is_left_out_and_one_that_moves_is_refused():
    t = stamps(3000, 240)
    joints = way(t) + 0.6
    assert not rival(t, joints).any()
    other = np.arange(len(t)) % 3 == 1
    still = np.where(other[:, None], [0.0, 0.1, 0.0], joints)
    assert (rival(t, still) == other).all()
    moving = np.where(other[:, None], way(t)[::-1] - 0.4, joints)
    with pytest.raises(DataError, match='two publishers'):
        rival(t, moving)


def test_joints_spread_over_messages_are_put_together_by_their_stamps():
    slow, fast = stamps(200, 90, BEGIN + 3_000_000), stamps(900, 400)
    fast = np.delete(fast, slice(300, 400))  # a gap, across which nothing is known
    first, second = way(slow)[:, :1], way(fast)[:, [0, 1]]
    parts = [
        Part((2,), np.arange(200) * 5, slow, first),
        Part((0, 1), np.arange(800), fast, second),
    ]
    whole = put_together(parts)
    assert whole.joints.shape[1] == 3
    assert set(whole.stamp) < set(slow)
    for stamp, joints in zip(whole.stamp, whole.joints, strict=True):
        assert not fast[299] < stamp < fast[300]
        expected = [np.interp(stamp - BEGIN, fast - BEGIN, column) for column in second.T]
        assert joints[:2] == pytest.approx(expected, abs=1e-9)
    assert len(whole.stamp) > 150
