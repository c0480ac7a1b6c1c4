# SPDX-License-Identifier: Apache-2.0
"""Pairing on made-up streams: an arm that moves and stops, a probe that reads all the while."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.pairing.readings import JointSample, Reading, Reason, Status
from calib_model.pairing.stop_and_go import Pairing, Refusal, SteadyPose, SteadySettings
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
OK = (0, 0, 0)
T0 = 1_700_000_000 * SECOND
SETTINGS = SteadySettings(settle=0.02, dwell=0.1, max_spread=1e-5)


def ns(seconds):
    return T0 + round(seconds * SECOND)


def arm_at(seconds):
    """Moves for 0.3 s, stands for 0.3 s, and so on; joint 2 goes twice as far as joint 1."""
    cycle, into = divmod(seconds, 0.6)
    return (cycle + min(into / 0.3, 1.0)) * np.array([0.3, 0.6])


def streams(stops=3, joint_rate=250.0, probe_rate=500.0, offset=0.0):
    end = 0.6 * stops + 0.15
    joints = [JointSample(ns(t), arm_at(t)) for t in np.arange(0, end, 1 / joint_rate)]
    times = np.arange(offset, end, 1 / probe_rate)
    readings = [Reading(ns(t), 1e-6 * np.array([t, 2 * t, -t]), OK) for t in times]
    return joints, readings


def fed(pairing, messages):
    """What comes of messages in their order."""
    outcomes = []
    for message in messages:
        add = pairing.add_joints if isinstance(message, JointSample) else pairing.add_reading
        outcomes += add(message)
    return outcomes


def in_time(*parts):
    return sorted((m for part in parts for m in part), key=lambda m: m.stamp)


def same(first, second):
    return len(first) == len(second) and all(
        type(a) is type(b)
        and a.stamp == b.stamp
        and np.array_equal(a.joints, b.joints)
        and (isinstance(a, Refusal) or np.array_equal(a.displacement, b.displacement))
        for a, b in zip(first, second, strict=True)
    )


def test_every_stop_gives_one_pose_with_the_joints_at_its_stamp():
    outcomes = fed(Pairing(SETTINGS), in_time(*streams()))
    assert [type(o) for o in outcomes] == [SteadyPose] * 3
    for stop, pose in enumerate(outcomes):
        start = 0.6 * stop + 0.3
        assert np.allclose(pose.joints, arm_at(start))
        assert ns(start + 0.02) <= pose.stamp <= ns(start + 0.125)
        assert 49 <= pose.readings <= 51
        t = (pose.stamp - T0) / SECOND
        assert np.allclose(pose.displacement, 1e-6 * np.array([t, 2 * t, -t]), atol=1e-14)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    joint_rate=st.floats(60.0, 500.0),
    probe_rate=st.floats(60.0, 1000.0),
    delay=st.floats(0.0, 0.4),
)
def test_arrival_of_one_stream_after_the_other_changes_nothing(joint_rate, probe_rate, delay):
    joints, readings = streams(2, joint_rate, probe_rate)
    together = fed(Pairing(SETTINGS), in_time(joints, readings))
    for shift in (ns_of(delay), -ns_of(delay)):
        arriving = sorted(
            [*joints, *readings],
            key=lambda m, shift=shift: m.stamp + isinstance(m, Reading) * shift,
        )
        assert same(fed(Pairing(SETTINGS), arriving), together)


def ns_of(seconds):
    return round(seconds * SECOND)


@pytest.mark.slow
@settings(max_examples=60)
@given(seed=st.integers(0, 2**32 - 1))
def test_messages_that_come_a_little_late_are_put_in_their_place(seed):
    joints, readings = streams(2)
    patient = SteadySettings(settle=0.02, dwell=0.1, max_spread=1e-5, lateness=0.02)
    expected = fed(Pairing(patient), in_time(joints, readings))
    rng = np.random.default_rng(seed)
    delayed = sorted([*joints, *readings], key=lambda m: m.stamp + rng.integers(0, ns_of(0.019)))
    pairing = Pairing(patient)
    found = fed(pairing, delayed)
    assert pairing.too_late == 0
    assert same(found, expected)
    assert len(found) == 2


def test_messages_later_than_that_are_left_out_and_counted():
    joints, readings = streams(1)
    pairing = Pairing(SETTINGS)
    fed(pairing, in_time(joints, readings))
    assert pairing.add_reading(readings[5]) == []
    assert pairing.add_joints(joints[5]) == []
    assert pairing.too_late == 2


@pytest.mark.parametrize(
    ('status', 'reason'),
    [
        (Status.NO_CONTACT, Reason.NO_CONTACT),
        (Status.OVER_TRAVEL, Reason.OVER_TRAVEL),
        (Status.WEAK_SIGNAL, Reason.WEAK_SIGNAL),
    ],
)
def test_one_bad_stylus_refuses_its_stop_and_no_other(status, reason):
    joints, readings = streams(2)
    spoilt = [
        r._replace(status=(0, status.value, 0)) if ns(0.4) < r.stamp < ns(0.41) else r
        for r in readings
    ]
    first, second = fed(Pairing(SETTINGS), in_time(joints, spoilt))
    assert isinstance(first, Refusal)
    assert first.reason is reason
    assert np.allclose(first.joints, arm_at(0.3))
    assert isinstance(second, SteadyPose)


def test_a_bad_reading_outside_the_window_is_none_of_its_business():
    joints, readings = streams(1)
    spoilt = [r._replace(status=(1, 1, 1)) if r.stamp < ns(0.315) else r for r in readings]
    outcomes = fed(Pairing(SETTINGS), in_time(joints, spoilt))
    assert [type(o) for o in outcomes] == [SteadyPose]


def test_a_refused_stop_is_where_the_arm_came_to_rest():
    way = 2e-3 * np.exp(-np.arange(200) / 12.0)  # it creeps into its place
    pairing = Pairing(SteadySettings(settle=0.2, dwell=0.3))
    outcomes = []
    for i, off in enumerate(way):
        stamp = SECOND + i * SECOND // 100
        outcomes += pairing.add_joints(JointSample(stamp, np.full(6, 0.4 + off)))
        outcomes += pairing.add_reading(Reading(stamp, np.zeros(3), (1, 1, 1)))
    (refused,) = outcomes
    assert refused.reason is Reason.NO_CONTACT
    assert np.abs(refused.joints - 0.4).max() < 5e-4


def test_styli_that_swing_refuse():
    joints, readings = streams(1)
    swinging = [
        r._replace(displacement=r.displacement + 1e-4 * np.sin(i)) for i, r in enumerate(readings)
    ]
    (outcome,) = fed(Pairing(SETTINGS), in_time(joints, swinging))
    assert outcome.reason is Reason.STYLI_UNSTEADY


def test_a_stop_without_readings_is_refused_as_such():
    joints, readings = streams(2)
    lost = [r for r in readings if not ns(0.31) < r.stamp < ns(0.5)]
    first, second = fed(Pairing(SETTINGS), in_time(joints, lost))
    assert first.reason is Reason.NO_READINGS
    assert isinstance(second, SteadyPose)


def test_a_stop_shorter_than_the_dwell_is_refused_as_unsteady():
    joints, readings = streams(1)
    short = [j for j in joints if j.stamp <= ns(0.36)]
    moving = [JointSample(ns(0.37 + 0.01 * i), arm_at(0.3) + 0.1 * i) for i in range(1, 20)]
    outcomes = fed(Pairing(SETTINGS), in_time([*short, *moving], readings))
    assert [o.reason for o in outcomes] == [Reason.ARM_UNSTEADY]


def test_a_slow_creep_is_no_stop():
    creeping = [JointSample(ns(t), np.array([0.01 * t])) for t in np.arange(0, 1, 0.004)]
    _, readings = streams(1)
    assert fed(Pairing(SETTINGS), in_time(creeping, readings)) == []


def test_joints_are_never_interpolated_across_a_gap():
    """The arm reports the same posture before and after a silence: who knows where it was."""
    joints, readings = streams(1)
    silent = [j for j in joints if not ns(0.31) < j.stamp < ns(0.55)]
    outcomes = fed(Pairing(SETTINGS), in_time(silent, readings))
    assert not any(isinstance(o, SteadyPose) for o in outcomes)


def test_a_pose_is_given_only_when_no_reading_of_its_window_can_come_any_more():
    joints, readings = streams(1)
    pairing = Pairing(SETTINGS)
    fed(pairing, joints)
    within = [r for r in readings if r.stamp < ns(0.3) + ns_of(0.12)]
    assert fed(pairing, within) == []
    (pose,) = fed(pairing, [r for r in readings if r.stamp >= ns(0.3) + ns_of(0.12)])
    assert isinstance(pose, SteadyPose)


def test_finish_settles_what_is_still_waiting():
    joints, readings = streams(1)
    pairing = Pairing(SETTINGS)
    fed(pairing, joints)
    fed(pairing, [r for r in readings if r.stamp < ns(0.4)])
    (pose,) = pairing.finish()
    assert isinstance(pose, SteadyPose)
    assert pairing.finish() == []


def test_readings_that_nobody_waits_for_are_forgotten():
    still = [JointSample(ns(t), np.zeros(2)) for t in np.arange(0, 20, 0.02)]
    readings = [Reading(ns(t), np.zeros(3), OK) for t in np.arange(0, 20, 0.01)]
    pairing = Pairing(SETTINGS)
    fed(pairing, in_time(still, readings))
    assert len(pairing._readings) < 20


@pytest.mark.parametrize(
    ('spoilt', 'reason'),
    [
        (lambda r: r._replace(displacement=np.array([0.0, np.nan, 0.0])), Reason.NO_NUMBER),
        (lambda r: r._replace(status=(0, 7, 0)), Reason.UNKNOWN_STATUS),
    ],
)
def test_what_a_driver_should_never_send_refuses_its_stop(spoilt, reason):
    joints, readings = streams(2)
    sent = [spoilt(r) if ns(0.4) < r.stamp < ns(0.41) else r for r in readings]
    first, second = fed(Pairing(SETTINGS), in_time(joints, sent))
    assert first.reason is reason
    assert isinstance(second, SteadyPose)


def test_stamps_that_fall_begin_anew_and_every_stop_of_both_times_counts():
    """An arm started anew, its clock behind: first its joint states fall, then the readings."""
    before, after = streams(2), streams(2)
    back = 5 * SECOND
    joints, readings = ([m._replace(stamp=m.stamp - back) for m in stream] for stream in after)
    pairing = Pairing(SETTINGS)
    outcomes = fed(pairing, in_time(*before)) + fed(pairing, in_time(joints, readings))
    outcomes += pairing.finish()
    poses = [each for each in outcomes if isinstance(each, SteadyPose)]
    assert pairing.steps_back == 1
    assert len(poses) == 4
    for pose in poses:
        shift = back if pose.stamp < T0 else 0
        assert pose.joints == pytest.approx(arm_at((pose.stamp + shift - T0) / SECOND), abs=1e-9)


def test_one_message_long_after_its_time_costs_at_most_the_stop_it_falls_into():
    joints, readings = streams(3)
    clean = fed(Pairing(SETTINGS), in_time(joints, readings))
    messages = in_time(joints, readings)
    late = messages[:900] + [joints[1]] + messages[900:]
    outcomes = fed(Pairing(SETTINGS), late)
    stamps = {each.stamp for each in clean if isinstance(each, SteadyPose)}
    assert {each.stamp for each in outcomes if isinstance(each, SteadyPose)} <= stamps
    assert len(outcomes) >= len(clean) - 1


def test_what_is_doubted_gives_no_pose_and_what_comes_after_does():
    joints, readings = streams(3)
    pairing = Pairing(SETTINGS)
    messages = in_time(joints, readings)
    outcomes = fed(pairing, [m for m in messages if m.stamp < ns(0.33)])
    pairing.start_over()
    outcomes += fed(pairing, [m for m in messages if m.stamp > ns(0.62)]) + pairing.finish()
    poses = [each for each in outcomes if isinstance(each, SteadyPose)]
    assert len(poses) == 2
    assert min(each.stamp for each in poses) > ns(0.9)


def few_readings(noise, stops=12, tail=None, off=0.0):
    """Four readings in a dwell, that scatter by `noise` (m); at stop `tail` the first is `off`."""
    joints, _ = streams(stops)
    draw = np.random.default_rng(8)
    readings = []
    for t in np.arange(0.0, 0.6 * stops + 0.15, 1 / 30.0):
        values = draw.normal(0.0, noise, 3)
        cycle, into = divmod(t, 0.6)
        if cycle == tail and 0.32 <= into <= 0.355:
            values[1] += off
        readings.append(Reading(ns(t), values, OK))
    return joints, readings


def test_few_readings_of_which_the_first_still_moved_are_refused_for_their_drift():
    settings = SteadySettings(settle=0.02, dwell=0.1)
    at_rest = fed(Pairing(settings), in_time(*few_readings(2e-7)))
    assert all(isinstance(each, SteadyPose) for each in at_rest) and len(at_rest) == 12
    for off in (7e-6, -1.2e-5):  # far less than the spread that is let pass
        outcomes = fed(Pairing(settings), in_time(*few_readings(2e-7, tail=9, off=off)))
        refused = [n for n, each in enumerate(outcomes) if isinstance(each, Refusal)]
        assert refused == [9] and outcomes[9].reason is Reason.STYLI_UNSTEADY


def test_few_readings_of_a_noisy_probe_are_not_taken_for_drift():
    settings = SteadySettings(settle=0.02, dwell=0.1)
    outcomes = fed(Pairing(settings), in_time(*few_readings(2.5e-6, stops=40)))
    assert sum(isinstance(each, SteadyPose) for each in outcomes) >= 39
