# SPDX-License-Identifier: Apache-2.0
"""Raw streams as arrays give the poses that they give message by message."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.pairing.from_streams import pair_streams, standing_outcomes
from calib_model.pairing.paired_readings import HandGuidedSettings
from calib_model.pairing.readings import JointSample, Reading
from calib_model.pairing.stop_and_go import Pairing, SteadyPose, SteadySettings
from calib_model.pairing.streams import RawStreams
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
T0 = 1_700_000_000 * SECOND
STEADY = SteadySettings(settle=0.02, dwell=0.06, max_spread=1e-5)


def streams_of(legs, joint_period=0.004, read_period=0.002, seed=0):
    """An arm that goes on `legs`: (seconds, rad/s of joint 1, status of the styli) each."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum([0.0, *(leg[0] for leg in legs)])
    angle = np.cumsum([0.0, *(leg[0] * leg[1] for leg in legs)])
    t, r = (np.arange(0, ends[-1], period) for period in (joint_period, read_period))
    q = np.stack([np.interp(t, ends, angle), np.zeros(len(t))], axis=1)
    leg = np.clip(np.searchsorted(ends, r, side='right') - 1, 0, len(legs) - 1)
    status = np.array([leg[2] for leg in legs], dtype=np.uint8)[leg]
    return RawStreams(
        T0 + np.round(t * SECOND).astype(np.int64),
        q,
        T0 + np.round(r * SECOND).astype(np.int64),
        rng.normal(1e-3, 1e-6, (len(r), 3)),
        np.stack([status, status, status], axis=1),
    )


def message_by_message(streams, steady):
    pairing, found = Pairing(steady), []
    joints = [
        JointSample(int(t), q) for t, q in zip(streams.joint_stamp, streams.joints, strict=True)
    ]
    readings = [
        Reading(int(t), d, tuple(map(int, s)))
        for t, d, s in zip(streams.reading_stamp, streams.displacement, streams.status, strict=True)
    ]
    for each in sorted([*joints, *readings], key=lambda each: each.stamp):
        take = pairing.add_joints if isinstance(each, JointSample) else pairing.add_reading
        found += take(each)
    return found + pairing.finish()


LEG = st.tuples(
    st.floats(0.005, 0.2), st.sampled_from([0.0, 0.0, 5e-4, 0.3, -0.5]), st.sampled_from([0, 0, 1])
)


@settings(max_examples=60)
@given(st.lists(LEG, min_size=2, max_size=12), st.sampled_from([0.001, 0.004, 0.03]))
def test_stops_are_those_of_the_live_pairing(legs, joint_period):
    streams = streams_of([*legs, (0.3, 0.4, 1)], joint_period)
    found, expected = list(standing_outcomes(streams, STEADY)), message_by_message(streams, STEADY)
    assert [type(each) for each in found] == [type(each) for each in expected]
    for one, other in zip(found, expected, strict=True):
        assert one.stamp == other.stamp
        assert one.joints.tobytes() == other.joints.tobytes()
        if isinstance(one, SteadyPose):
            assert one.displacement.tobytes() == other.displacement.tobytes()
            assert one.readings == other.readings
        else:
            assert one.reason == other.reason


def test_the_data_tell_an_arm_that_stops_from_one_that_is_led():
    stops = [(0.2, 0.5, 1), (0.05, 0.01, 0), (0.3, 0.0, 0), (0.05, -0.01, 0)] * 6
    found = pair_streams(streams_of([*stops, (0.1, 0.5, 1)]), STEADY)
    assert (found.standing, len(found.poses)) == (True, 6)
    led = [(0.5, 0.5, 1), (0.3, 0.0, 0), (8.0, 0.5, 0)] * 3  # rests once before it is led
    found = pair_streams(streams_of([*led, (0.1, 0.5, 1)]), STEADY)
    assert not found.standing
    assert len(found.poses) == pytest.approx(3 * 4.0 / 0.1, abs=6)
    assert 'led around the spheres in contact' in found.lines()[0]
    assert pair_streams(streams_of(led), STEADY, standing=True).standing


def test_poses_of_a_led_arm_have_the_joints_of_their_instant():
    """Joints on a sine, states at 100 Hz: the way between them is known to a microradian."""
    t, r = np.arange(0, 4, 0.01), np.arange(0.0037, 3.9, 0.002)
    way = lambda at: np.stack([np.sin(2 * at), 0.5 * np.cos(3 * at)], axis=1)  # noqa: E731
    streams = RawStreams(
        np.round(t * SECOND).astype(np.int64),
        way(t),
        np.round(r * SECOND).astype(np.int64),
        np.zeros((len(r), 3)),
        np.zeros((len(r), 3), dtype=np.uint8),
    )
    poses = pair_streams(streams, STEADY, standing=False).poses
    assert len(poses) > 30
    for pose in poses:
        assert np.abs(pose.joints - way(np.array([pose.stamp / SECOND]))[0]).max() < 1e-6


def test_slow_joint_states_of_which_nothing_was_said_are_bridged_all_the_same():
    led = [(0.5, 0.5, 1), (8.0, 0.5, 0)] * 2
    found = pair_streams(streams_of(led, joint_period=0.03), STEADY)
    assert not found.standing
    assert len(found.poses) == pytest.approx(2 * 4.0 / 0.1, abs=4)
    asked = HandGuidedSettings(spacing=0.5, max_gap=0.04)
    found = pair_streams(streams_of(led, joint_period=0.03), STEADY, guided=asked)
    assert len(found.poses) == pytest.approx(2 * 4.0 / 0.5, abs=2)


def test_a_contact_is_not_followed_across_a_gap_in_the_joint_states():
    streams = streams_of([(4.0, 0.5, 0)])
    keep = np.ones(len(streams.joint_stamp), dtype=bool)
    keep[300:700] = False
    holed = RawStreams(
        streams.joint_stamp[keep],
        streams.joints[keep],
        streams.reading_stamp,
        streams.displacement,
        streams.status,
    )
    seconds = [(pose.stamp - T0) / SECOND for pose in pair_streams(holed, STEADY).poses]
    assert seconds
    assert not [second for second in seconds if 1.2 < second < 2.795]


def test_contacts_that_come_well_after_the_stop_are_poses_too():
    """Slow readings, and a probe that is in contact only 60 ms after the arm has stopped."""
    stop = [(0.5, 0.5, 1), (0.06, 0.0, 1), (0.4, 0.0, 0), (0.05, 0.0, 1)]
    streams = streams_of([*stop * 6, (0.1, 0.5, 1)], joint_period=0.01, read_period=0.02)
    noise = np.random.default_rng(1).normal(0, 2e-6, streams.joints.shape)
    streams = replace(streams, joints=streams.joints + noise)
    found = pair_streams(streams, SteadySettings())
    assert (found.standing, len(found.poses)) == (True, 6)
    assert found.stops <= 1  # none but by chance
    assert 'stands in contact for each' in found.lines()[0]
    for number, pose in enumerate(found.poses, start=1):
        assert pose.joints[0] == pytest.approx(0.25 * number, abs=5e-6)
        assert pose.displacement == pytest.approx(1e-3, abs=2e-6)
        assert pose.readings >= 10
    drifting = streams.displacement + np.linspace(0, 0.1, len(streams.displacement))[:, None]
    assert not pair_streams(replace(streams, displacement=drifting), SteadySettings(), True).poses
