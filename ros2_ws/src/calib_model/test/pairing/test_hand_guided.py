# SPDX-License-Identifier: Apache-2.0
"""Pairing on the move: joints at the reading's stamp, and every reading accounted for, once."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.pairing.hand_guided import LONGEST_WAIT, HandGuidedPairing
from calib_model.pairing.paired_readings import NO_JOINTS, OUT_OF_ORDER, HandGuidedSettings
from calib_model.pairing.readings import JointSample, Reading
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
OK = (0, 0, 0)
T0 = 1_700_000_000 * SECOND
SETTINGS = HandGuidedSettings()


def ns(seconds):
    return T0 + round(seconds * SECOND)


def arm_at(t):
    return np.array([np.sin(t), 0.5 * np.cos(2 * t)])


def streams(seconds=1.0, joint_rate=250.0, probe_rate=500.0, offset=0.0007):
    joints = [JointSample(ns(t), arm_at(t)) for t in np.arange(0, seconds, 1 / joint_rate)]
    times = np.arange(offset, seconds, 1 / probe_rate)
    return joints, [Reading(ns(t), np.array([t, 0.0, 0.0]), OK) for t in times]


def fed(pairing, messages):
    paired = []
    for message in messages:
        add = pairing.add_joints if isinstance(message, JointSample) else pairing.add_reading
        paired += add(message)
    return paired + pairing.finish()


def in_time(*parts):
    return sorted((m for part in parts for m in part), key=lambda m: m.stamp)


def same(first, second):
    return len(first) == len(second) and all(
        (a.stamp, a.reason) == (b.stamp, b.reason)
        and (a.reason or np.array_equal(a.joints, b.joints))
        and np.array_equal(a.displacement, b.displacement)
        for a, b in zip(first, second, strict=True)
    )


def test_readings_paired_across_missing_joint_states_are_counted():
    joints, readings = streams(probe_rate=1000.0)
    whole, holed = HandGuidedPairing(SETTINGS), HandGuidedPairing(SETTINGS)
    fed(whole, in_time(joints, readings))
    assert whole.bridged == HandGuidedPairing(SETTINGS).bridged == 0
    left = [each for i, each in enumerate(joints) if i not in (50, 120, 121)]
    paired = fed(holed, in_time(left, readings))
    gaps = [(joints[49].stamp, joints[51].stamp), (joints[119].stamp, joints[122].stamp)]
    across = [one for one in readings if any(a <= one.stamp <= b for a, b in gaps)]
    assert holed.bridged == len(across) == 8 + 12
    assert not any(each.reason for each in paired if each.stamp < joints[-1].stamp)


def test_every_reading_has_the_joints_at_its_stamp():
    joints, readings = streams()
    paired = fed(HandGuidedPairing(SETTINGS), in_time(joints, readings))
    assert [each.stamp for each in paired] == [each.stamp for each in readings]
    inside = [each for each in paired if not each.reason]
    assert len(paired) - len(inside) <= 2  # after the last joint state
    # half a joint period off a curve of unit acceleration: 2e-6 rad
    for each in inside:
        assert np.abs(each.joints - arm_at((each.stamp - T0) / SECOND)).max() < 5e-6


@pytest.mark.slow
@settings(max_examples=40)
@given(
    joint_rate=st.floats(60.0, 500.0),
    probe_rate=st.floats(60.0, 1000.0),
    delay=st.floats(-0.6, 0.6),
)
def test_arrival_of_one_stream_after_the_other_changes_nothing(joint_rate, probe_rate, delay):
    joints, readings = streams(0.8, joint_rate, probe_rate)
    together = fed(HandGuidedPairing(SETTINGS), in_time(joints, readings))
    shift = round(delay * SECOND)
    arriving = sorted([*joints, *readings], key=lambda m: m.stamp + isinstance(m, Reading) * shift)
    assert same(fed(HandGuidedPairing(SETTINGS), arriving), together)


@pytest.mark.slow
@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1))
def test_messages_permuted_within_the_lateness_give_the_same(seed):
    joints, readings = streams(0.6)
    patient = HandGuidedSettings(lateness=0.02)
    expected = fed(HandGuidedPairing(patient), in_time(joints, readings))
    rng = np.random.default_rng(seed)
    delayed = sorted(
        [*joints, *readings], key=lambda m: m.stamp + rng.integers(0, round(0.019 * SECOND))
    )
    assert same(fed(HandGuidedPairing(patient), delayed), expected)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    lost=st.floats(0.0, 0.5),
    twice=st.floats(0.0, 0.2),
    late=st.floats(0.0, 2.5),
    lateness=st.floats(0.0, 0.05),
)
def test_whatever_arrives_is_paired_or_refused_once(seed, lost, twice, late, lateness):
    """Lost, doubled and wildly late messages of both streams, also across a step back."""
    rng = np.random.default_rng(seed)
    messages = [m for m in in_time(*streams(0.5)) if rng.random() >= lost]
    messages += [m for m in messages if rng.random() < twice]
    delay = rng.exponential(late * SECOND * 0.1, len(messages)).astype(int)
    arriving = [messages[i] for i in np.argsort([m.stamp for m in messages] + delay)]
    sent = Counter(m.stamp for m in arriving if isinstance(m, Reading))
    paired = fed(HandGuidedPairing(HandGuidedSettings(lateness=lateness)), arriving)
    assert Counter(each.stamp for each in paired) == sent
    good = [each.stamp for each in paired if not each.reason]
    assert len(set(good)) == len(good)
    for each in paired:
        if not each.reason:
            assert np.abs(each.joints - arm_at((each.stamp - T0) / SECOND)).max() < 2e-4


def test_joints_are_never_interpolated_across_a_gap():
    joints, readings = streams()
    silent = [j for j in joints if not ns(0.3) < j.stamp < ns(0.4)]
    paired = fed(HandGuidedPairing(SETTINGS), in_time(silent, readings))
    missing = [each for each in paired if each.reason == NO_JOINTS and each.stamp < ns(0.9)]
    assert len(missing) == pytest.approx(50, abs=2)
    assert all(ns(0.3) <= each.stamp <= ns(0.4) for each in missing)


@pytest.mark.parametrize(
    ('status', 'reason'),
    [(1, 'no contact'), (2, 'over-travel'), (3, 'weak signal'), (9, 'unknown status')],
)
def test_one_bad_stylus_refuses_its_reading_and_no_other(status, reason):
    joints, readings = streams(0.2)
    readings[40] = readings[40]._replace(status=(0, status, 0))
    paired = fed(HandGuidedPairing(SETTINGS), in_time(joints, readings))
    assert [each.reason for each in paired[38:43]] == ['', '', reason, '', '']


def test_a_reading_that_comes_twice_or_late_is_refused_as_such():
    joints, readings = streams(0.2)
    paired = fed(
        HandGuidedPairing(SETTINGS), [*in_time(joints, readings), readings[10], readings[50]]
    )
    refused = [each.stamp for each in paired if each.reason == OUT_OF_ORDER]
    assert refused == [readings[10].stamp, readings[50].stamp]


def test_streams_of_other_clocks_are_refused_and_not_hoarded():
    joints, readings = streams(0.5)
    ahead = [r._replace(stamp=r.stamp + 3600 * SECOND + i * SECOND) for i, r in enumerate(readings)]
    pairing, paired = HandGuidedPairing(SETTINGS), []
    for reading in ahead:
        paired += pairing.add_reading(reading)
    for sample in joints:
        paired += pairing.add_joints(sample)
    assert len(pairing._waiting) <= LONGEST_WAIT // SECOND + 1
    paired += pairing.finish()
    assert len(paired) == len(ahead)
    assert {each.reason for each in paired} == {NO_JOINTS}


def test_a_driver_started_anew_with_earlier_stamps_is_paired_too():
    joints, readings = streams(0.5)
    early = in_time(joints, readings)
    later = [m._replace(stamp=m.stamp + 100 * SECOND) for m in early]
    paired = fed(HandGuidedPairing(SETTINGS), [*later, *early])
    assert len(paired) == 2 * len(readings)
    assert sum(not each.reason for each in paired) >= 2 * (len(readings) - 2)


def test_a_shift_moves_the_readings_and_leaves_their_stamps():
    joints, readings = streams()
    behind = [r._replace(stamp=r.stamp - round(0.003 * SECOND)) for r in readings]
    right = fed(HandGuidedPairing(SETTINGS), in_time(joints, readings))
    shifted = fed(HandGuidedPairing(SETTINGS, round(0.003 * SECOND)), in_time(joints, behind))
    assert [each.stamp for each in shifted] == [each.stamp for each in behind]
    assert all(
        np.array_equal(a.joints, b.joints)
        for a, b in zip(right, shifted, strict=True)
        if not a.reason
    )
