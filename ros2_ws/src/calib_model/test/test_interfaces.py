# SPDX-License-Identifier: Apache-2.0
"""Bags need no built workspace: what cdr knows of the messages must be the messages."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib_model.bags import cdr
from calib_model.topics import (
    DISPLACEMENTS,
    JOINT_STATE,
    MEASURED_POINT,
    PROBING_POSE,
    STRING,
)

MESSAGES = Path(__file__).resolve().parents[2] / 'calib_interfaces' / 'msg'
STAMP = 1_700_000_000_123_456_789
TURN = np.array([0.5, -0.5, 0.5, 0.5])


def fields(text: str) -> list[str]:
    """A .msg file's lines without comments and with single spaces."""
    lines = (' '.join(line.split('#')[0].split()) for line in text.splitlines())
    return [line for line in lines if line]


@pytest.mark.parametrize('name', sorted(n for n in cdr.DEFINITIONS if n.startswith('calib_')))
def test_definitions_are_those_of_the_msg_files(name: str) -> None:
    file = MESSAGES / f'{name.split("/")[-1]}.msg'
    assert fields(cdr.DEFINITIONS[name]) == fields(file.read_text())


def ours_and_theirs() -> dict[str, tuple[Any, Any]]:
    """Every message that a bag of ours may hold, made by calib_model and by rclpy's classes."""
    interfaces = pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
    std, sensor = pytest.importorskip('std_msgs.msg'), pytest.importorskip('sensor_msgs.msg')
    time = pytest.importorskip('builtin_interfaces.msg').Time
    header = std.Header(stamp=time(sec=1_700_000_000, nanosec=123_456_789), frame_id='base_link')
    joints, values = np.array([0.1, -2.5, 3e-17]), np.array([1e-3, -1e-3, 0.0])
    return {
        STRING: (cdr.string('name: ü\n'), std.String(data='name: ü\n')),
        JOINT_STATE: (
            cdr.joint_state(STAMP, 'base_link', ['a', 'bcd', ''], joints),
            sensor.JointState(header=header, name=['a', 'bcd', ''], position=joints.tolist()),
        ),
        DISPLACEMENTS: (
            cdr.displacements(STAMP, 'base_link', values, np.array([0, 1, 3])),
            interfaces.StylusDisplacements(header=header, displacement=values, status=[0, 1, 3]),
        ),
        PROBING_POSE: (
            cdr.probing_pose(STAMP, 'base_link', 7, 14, joints, values, 25),
            interfaces.ProbingPose(
                header=header,
                location=7,
                sphere=14,
                joint_position=joints.tolist(),
                displacement=values,
                readings=25,
            ),
        ),
        MEASURED_POINT: (
            cdr.measured_point(STAMP, 'base_link', 'nest 2', 3, joints, values, TURN, 2e-5),
            interfaces.MeasuredPoint(
                header=header,
                target='nest 2',
                station=3,
                joint_position=joints.tolist(),
                position=values,
                orientation=TURN,
                sigma=2e-5,
            ),
        ),
    }


@pytest.mark.parametrize('name', [STRING, JOINT_STATE, DISPLACEMENTS, PROBING_POSE, MEASURED_POINT])
def test_bytes_are_those_of_rclpy_both_ways(name: str) -> None:
    serialization = pytest.importorskip('rclpy.serialization', reason='no ROS 2 here')
    ours, theirs = ours_and_theirs()[name]
    data, other = cdr.encode(ours), serialization.serialize_message(theirs)
    assert len(data) <= len(other) <= len(data) + cdr.SLACK
    # Fast CDR leaves what its memory held in the gaps before aligned values: those mean nothing
    meant = [i for i in range(len(data)) if not is_padding(name, data, i)]
    assert len(meant) > 0.7 * len(data)
    assert [data[i] for i in meant] == [other[i] for i in meant]
    assert serialization.deserialize_message(data, type(theirs)) == theirs
    assert cdr.encode(cdr.decode(name, other)) == data


def is_padding(name: str, data: bytes, i: int) -> bool:
    """Whether byte i may be anything: the message read from the changed bytes is the same."""
    changed = data[:i] + bytes([data[i] ^ 0xFF]) + data[i + 1 :]
    try:
        return i >= 4 and cdr.encode(cdr.decode(name, changed)) == data
    except ValueError:
        return False


@pytest.mark.parametrize('name', [JOINT_STATE, DISPLACEMENTS, PROBING_POSE])
def test_type_hashes_are_those_of_the_generated_types(name: str) -> None:
    index = pytest.importorskip('ament_index_python', reason='no ROS 2 here')
    package, _, kind = name.split('/')
    if not index.has_resource('packages', package):
        pytest.skip('the workspace is not built')
    share = Path(index.get_package_share_directory(package))
    text = (share / f'msg/{kind}.json').read_text()
    found = re.search(rf'"{name}",\s*"hash_string": "(\w+)"', text)
    assert found is not None
    assert cdr.type_hash(name) == found[1]


@pytest.mark.parametrize('name', [STRING, JOINT_STATE, DISPLACEMENTS, PROBING_POSE])
def test_bytes_cut_anywhere_are_refused(name: str) -> None:
    values = np.zeros(3)
    data = cdr.encode(
        {
            STRING: cdr.string('text'),
            JOINT_STATE: cdr.joint_state(STAMP, 'f', ['a'], values),
            DISPLACEMENTS: cdr.displacements(STAMP, 'f', values, values),
            PROBING_POSE: cdr.probing_pose(STAMP, 'f', 1, 2, values, values, 3),
        }[name]
    )
    assert cdr.decode(name, data) is not None
    for end in range(len(data)):
        with pytest.raises(ValueError, match=f'not a {name}'):
            cdr.decode(name, data[:end])


def test_what_rclpy_leaves_behind_a_message_is_let_pass_and_more_is_not() -> None:
    data = cdr.encode(cdr.joint_state(STAMP, 'f', ['a'], np.zeros(1)))
    message = cdr.decode(JOINT_STATE, data + b'\x9d\x7f\x00\x00\x20\xd5\xbbG')
    assert (message.name, len(message.velocity), len(message.effort)) == (['a'], 0, 0)
    with pytest.raises(ValueError, match='65 bytes too many'):
        cdr.decode(JOINT_STATE, data + bytes(65))


def test_big_endian_bytes_are_read() -> None:
    text = b'\x00\x00\x00\x00' + b'\x00\x00\x00\x03' + b'ab\x00'
    assert cdr.decode(STRING, text).data == 'ab'


def test_random_bytes_never_raise_anything_else() -> None:
    rng = np.random.default_rng(0)
    for name in (STRING, JOINT_STATE, DISPLACEMENTS, PROBING_POSE):
        for _ in range(500):
            data = b'\x00\x01\x00\x00' + rng.bytes(int(rng.integers(0, 120)))
            try:
                cdr.decode(name, data)
            except ValueError as error:
                assert str(error).startswith(f'not a {name}')
