# SPDX-License-Identifier: Apache-2.0
"""The order found for a whole stream is the one that live pairing finds message by message."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from calib_model.pairing.hand_guided import HandGuidedPairing, HandGuidedSettings
from calib_model.pairing.paired_readings import OUT_OF_ORDER
from calib_model.pairing.readings import Reading
from calib_model.pairing.streams import in_order, unbroken
from calib_model.stamps import SECOND

pytestmark = pytest.mark.timeout(60)
MS = SECOND // 1000


@settings(max_examples=200, deadline=None)
@given(
    st.lists(st.integers(0, 300), min_size=1, max_size=40),
    st.sampled_from([0.0, 0.003, 0.05, 0.4]),
)
def test_what_comes_too_late_is_what_is_too_late_live(ticks, lateness):
    stamp = np.array(ticks, dtype=np.int64) * MS
    live = HandGuidedPairing(HandGuidedSettings(lateness=lateness))
    settled = []
    for each in stamp.tolist():
        settled += live.add_reading(Reading(each, np.zeros(3), (0, 0, 0)))
    settled += live.finish()
    late = sorted(each.stamp for each in settled if each.reason == OUT_OF_ORDER)
    rows = in_order(stamp, lateness)
    assert (np.diff(stamp[rows]) > 0).all()
    left = np.delete(stamp, rows)
    assert sorted(left.tolist()) == late


def test_what_comes_in_order_stays_and_what_comes_twice_counts_once():
    assert in_order(np.array([3, 5, 9]), 0.0).tolist() == [0, 1, 2]
    assert in_order(np.array([3, 5, 5, 4, 9]), 0.0).tolist() == [0, 1, 4]
    assert in_order(np.array([3, 5, 5, 4, 9]), 1.0).tolist() == [0, 3, 1, 4]
    assert in_order(np.zeros(0, dtype=np.int64), 0.0).tolist() == []


def test_streams_break_where_one_of_them_falls_back():
    joints = np.array([0, 4, 8, 2, 6]) * SECOND
    readings = np.array([1, 5, 9, 3, 7]) * SECOND
    stamp = np.stack([joints, readings], axis=1).reshape(-1)
    stream = np.arange(10) % 2
    parts = [stamp[part] // SECOND for part in unbroken(stamp, stream)]
    assert [part.tolist() for part in parts] == [[0, 1, 4, 5, 8, 9], [2, 3, 6, 7]]


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 5), max_size=3000), st.integers(0, 2**32 - 1))
def test_a_long_stream_breaks_where_the_newest_is_left_behind(values, seed):
    stamp = np.array(values, dtype=np.int64)
    stream = np.random.default_rng(seed).integers(0, 2, len(stamp))
    begins, newest = [], {}
    for row, (each, number) in enumerate(zip(stamp.tolist(), stream.tolist(), strict=True)):
        if row == 0 or each < newest.get(number, each) - 3:
            begins.append(row)
            newest = {}
        newest[number] = max(newest.get(number, each), each)
    assert [part.start for part in unbroken(stamp, stream, 3)] == begins
