# SPDX-License-Identifier: Apache-2.0
"""Reading poses in bulk gives what reading them one by one gives, or leaves them to that."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from calib_model.bags import cdr
from calib_model.bags.pose_columns import decode_poses

FINITE = st.floats(allow_nan=False, allow_infinity=False)


def message(frame: str, joints: list[float], number: int = 1) -> bytes:
    values = np.array([1e-3, -2e-3, 3e-3]) * number
    stamp = 1_700_000_000_123_456_789 + number
    return cdr.encode(
        cdr.probing_pose(stamp, frame, number, number + 5, np.array(joints), values, number + 7)
    )


@given(st.text(max_size=20), st.lists(FINITE, max_size=12), st.binary(max_size=64))
def test_a_block_is_what_its_messages_say(frame: str, joints: list[float], junk: bytes) -> None:
    messages = [message(frame, joints, number) + junk for number in (1, 2, 40)]
    block = decode_poses(messages)
    assert block is not None
    for row, data in enumerate(messages):
        pose = cdr.decode('calib_interfaces/msg/ProbingPose', data)
        assert (block.location[row], block.sphere[row]) == (pose.location, pose.sphere)
        assert block.joints[row].tobytes() == pose.joint_position.tobytes()
        assert block.displacement[row].tobytes() == pose.displacement.tobytes()
        assert block.stamp[row] == cdr.stamp_of(pose)
        assert block.readings[row] == pose.readings


@pytest.mark.parametrize(
    'messages',
    [
        [],
        [message('base', [1.0]), message('longer_base', [1.0])],
        [message('base', [1.0]), message('base', [1.0, 2.0])],
        [message('a', [1.0, 2.0]), message('a' * 9, [1.0])],  # as long as each other
        [message('base', [1.0])[:-1]],
        [message('base', [1.0]) + bytes(65)],
        [b'\x00\x00' + message('base', [1.0])[2:]],
        [b''],
    ],
)
def test_what_is_not_of_one_layout_is_left_to_be_read_one_by_one(messages: list[bytes]) -> None:
    assert decode_poses(messages) is None


def test_the_definitions_are_those_of_jazzy() -> None:
    for name in cdr.DEFINITIONS:
        every = cdr._all_types()
        assert cdr.typestore().hash_rihs01(name) == every.hash_rihs01(name)
        assert cdr.typestore().generate_msgdef(name, ros_version=2) == every.generate_msgdef(
            name, ros_version=2
        )
