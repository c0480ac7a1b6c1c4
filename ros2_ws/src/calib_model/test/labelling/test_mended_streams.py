# SPDX-License-Identifier: Apache-2.0
"""Streams that were recorded badly: paired where that is sound, the cause named where it is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calib_model.errors import BagError
from calib_model.labelling.mended_streams import mended_poses
from calib_model.pairing import Paired, RawStreams, SteadySettings, pair_streams
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
NAMES = ('shoulder', 'elbow')
PLACES = np.array([[0.2, -3.0], [0.9, 3.1], [-0.4, 2.7], [0.1, -2.9], [1.3, -3.1]])


def standing(rate, offset=0.0):
    """An arm that goes to five places for a second each and touches a sphere in each."""
    t = np.arange(0, 9.99, 1 / rate)
    place, beyond = np.divmod(t, 2.0)
    place = np.clip(place.astype(int), 0, 4)
    before = np.clip(place - 1, 0, 4)
    u = np.clip(beyond, 0, 1)[:, None]
    joints = PLACES[before] + u * (PLACES[place] - PLACES[before])
    r = np.arange(0, 9.9, 0.005)
    there = (np.mod(r, 2.0) > 1.3) & (np.mod(r, 2.0) < 1.8)
    depth = np.where(there, 1e-3 * (1 + np.floor(r / 2)), 0.0)[:, None] * [1.0, 1.2, 0.8]
    return RawStreams(
        (t * SECOND).astype(np.int64) + SECOND,
        joints + offset,
        (r * SECOND).astype(np.int64) + SECOND,
        depth,
        np.where(there, 0, 1)[:, None].repeat(3, axis=1).astype(np.uint8),
    )


def pair(streams: RawStreams, settings: SteadySettings) -> Paired:
    return pair_streams(streams, settings)


def mended(*parts):
    return mended_poses('x.mcap', parts, NAMES, SteadySettings(), pair)


def places(found):
    return np.round(np.array([pose.joints for pose in found.poses]), 6)


@pytest.mark.parametrize('rate', [200, 9])
def test_an_arm_that_stops_is_paired_however_seldom_its_states_come(rate):
    found = mended(standing(rate))
    assert found.standing and len(found.poses) == 5
    assert np.abs(places(found) - PLACES).max() < 1e-6


def test_an_encoder_that_wraps_is_counted_as_it_counts():
    streams = standing(200)
    wrapped = np.mod(streams.joints + np.pi, 2 * np.pi) - np.pi
    wrapped[:, 1] = np.mod(streams.joints[:, 1] - 3.1 + np.pi, 2 * np.pi) - np.pi
    found = mended(replace(streams, joints=wrapped))
    assert len(found.poses) == 5
    off = places(found)[:, 1] - (PLACES[:, 1] - 3.1)
    assert np.abs(np.mod(off + 1, 2 * np.pi) - 1).max() < 1e-5
    assert np.abs(places(found)[:, 1]).max() <= np.pi + 1e-9
    assert any('joint elbow jumps by a turn' in line for line in found.lines)


def test_parts_of_a_clock_that_was_set_back_are_used_each():
    first, second = standing(150), standing(150, offset=0.01)
    found = mended(first, second)
    assert len(found.poses) == 10
    assert np.abs(places(found)[5:] - PLACES - 0.01).max() < 1e-6
    assert any('part 2 of 2' in line for line in found.lines)


def test_a_second_publisher_is_left_out_by_name():
    streams = standing(200)
    other = np.arange(len(streams.joints)) % 2 == 1
    both = np.where(other[:, None], [0.5, 0.5], streams.joints)
    found = mended(replace(streams, joints=both))
    assert len(found.poses) == 5
    assert any('a second publisher' in line for line in found.lines)
    moving = np.where(other[:, None], streams.joints[::-1] + 0.5, streams.joints)
    with pytest.raises(BagError, match=r'x\.mcap: .*two publishers'):
        mended(replace(streams, joints=moving))


def led(sent, new):
    """An arm that is led in contact all the time, its states sent and made anew so often."""
    t = np.arange(0, 8, 1 / sent)
    made = np.floor(t * new + 1e-9) / new
    r = np.arange(0, 8, 0.004)
    return RawStreams(
        (t * SECOND).astype(np.int64),
        np.column_stack([0.5 * made + np.sin(made), np.cos(2 * made)]),
        (r * SECOND).astype(np.int64),
        1e-3 + 1e-4 * np.sin(np.outer(r, [1.0, 2.0, 3.0])),
        np.zeros((len(r), 3), np.uint8),
    )


def test_a_led_arm_needs_states_that_are_new_often_enough():
    for sent, new, said in (
        (200.0, 7.0, r'new [67]\.\d times a second \(200 are sent, most of them repeat\)'),
        (11.0, 11.0, r'new 11\.0 times a second: of an arm that is led 50 and more are needed'),
    ):
        with pytest.raises(BagError, match=said):
            mended(led(sent, new))
    slow = mended(led(31.0, 31.0))
    assert slow.poses and any(
        'warning: joint positions are new 31.0' in line for line in slow.lines
    )
    well = mended(led(120.0, 120.0))
    assert well.poses and not any('warning' in line for line in well.lines)
