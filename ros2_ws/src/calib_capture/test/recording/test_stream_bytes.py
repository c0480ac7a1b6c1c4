# SPDX-License-Identifier: Apache-2.0
"""What is read out of a message's bytes is what the message says."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calib_capture.recording.stream_bytes import JointStateReader, read_reading
from calib_model.bags import cdr
from calib_model.topics import DISPLACEMENTS, JOINT_STATE

NAME = st.text(st.characters(codec='utf-8', exclude_characters='\0'), max_size=9)
STAMP = st.integers(0, 2**31 * 10**9 - 1)
NUMBER = st.floats(-1e6, 1e6)


@given(STAMP, NAME, st.lists(st.floats(width=64), min_size=3, max_size=3), st.booleans())
def test_a_reading_is_what_the_message_says(stamp, frame, values, little):
    message = cdr.displacements(stamp, frame, np.array(values), np.array([0, 2, 255]))
    raw = bytes(cdr.typestore().serialize_cdr(message, DISPLACEMENTS, little_endian=little))
    found = read_reading(raw)
    assert found.stamp == stamp and found.status == (0, 2, 255)
    assert np.array_equal(found.displacement, values, equal_nan=True)


@pytest.mark.slow
@given(st.data())
def test_joints_are_found_by_name_in_one_message_after_the_other(data):
    wanted = data.draw(st.lists(NAME, min_size=1, max_size=4, unique=True))
    reader = JointStateReader(wanted)
    for _ in range(4):
        order = data.draw(st.permutations([*wanted, *data.draw(st.lists(NAME, max_size=2))]))
        position = data.draw(st.lists(NUMBER, min_size=len(order), max_size=len(order)))
        frame, stamp = data.draw(NAME), data.draw(STAMP)
        little = data.draw(st.booleans())
        message = cdr.joint_state(stamp, frame, tuple(order), np.array(position))
        raw = bytes(cdr.typestore().serialize_cdr(message, JOINT_STATE, little_endian=little))
        found = reader.read(raw)
        assert found is not None and found.stamp == stamp
        assert found.joints.tolist() == [position[order.index(name)] for name in wanted]


@pytest.mark.parametrize(
    ('names', 'position'),
    [(('a', 'c'), (1, 2)), (('a', 'b'), (1,)), (('a', 'b'), (1, np.nan)), (('a', 'b'), (2e6, 0))],
)
def test_a_message_without_a_number_for_each_joint_has_none(names, position):
    message = cdr.joint_state(3, '', names, np.array(position, dtype=float))
    assert JointStateReader(('b', 'a')).read(cdr.encode(message)) is None
