# SPDX-License-Identifier: Apache-2.0
"""Many raw messages at once say what each says by itself."""

import numpy as np
import pytest

from calib_model.bags import cdr
from calib_model.pairing.stream_columns import joint_blocks, little_endian, reading_blocks
from calib_model.topics import DISPLACEMENTS, JOINT_STATE

NAMES = [['a', 'bcd', 'ef'], ['bcd', 'a', 'ef', 'ghijk'], ['x']]


def states(count=60):
    """Joint states of three publishers with frames of several lengths, one after the other."""
    rng = np.random.default_rng(1)
    found = []
    for i in range(count):
        names = NAMES[i % 3]
        frame = 'base'[: i % 5]
        found.append(cdr.joint_state(i * 10**9 + i, frame, names, rng.uniform(-3, 3, len(names))))
    return found


def with_garbage_in_padding(data, kind, rng):
    """Other bytes where no field is, as encoders leave them: all that change nothing."""
    plain = cdr.decode(kind, data)
    noisy = bytearray(data)
    for place in range(4, len(data)):
        tried = bytearray(noisy)
        tried[place] ^= int(rng.integers(1, 256))
        try:
            if cdr.encode(cdr.decode(kind, bytes(tried))) == cdr.encode(plain):
                noisy = tried
        except ValueError:
            continue
    return bytes(noisy)


def assert_joints(messages, data):
    seen = np.zeros(len(messages), dtype=bool)
    for block in joint_blocks(data):
        for i, row in enumerate(block.rows):
            assert list(block.names) == messages[row].name
            assert block.position[i].tobytes() == np.asarray(messages[row].position).tobytes()
            assert block.stamp[i] == cdr.stamp_of(messages[row])
            seen[row] = True
    assert seen.all()


def test_joint_states_of_several_publishers_keep_their_own_names():
    messages = states()
    assert_joints(messages, [cdr.encode(message) for message in messages])


def test_what_is_in_the_padding_means_nothing():
    rng, messages = np.random.default_rng(2), states(12)
    data = [with_garbage_in_padding(cdr.encode(m), JOINT_STATE, rng) for m in messages]
    assert data != [cdr.encode(message) for message in messages]
    assert_joints(messages, data)


def test_velocities_and_efforts_are_no_positions():
    kind = cdr.typestore().types[JOINT_STATE]
    values = np.arange(4.0)
    message = kind(cdr.header(5, ''), NAMES[1], values, 10 + values, 20 + values)
    ((block,),) = [list(joint_blocks([cdr.encode(message)] * 3))]
    assert block.position.tolist() == [values.tolist()] * 3
    none = kind(cdr.header(5, ''), NAMES[1], np.zeros(0), values, values)
    ((block,),) = [list(joint_blocks([cdr.encode(none)]))]
    assert (block.names, block.position.shape) == ((), (1, 0))


def test_readings_come_with_their_status():
    rng = np.random.default_rng(3)
    messages = [
        cdr.displacements(10**9 + i, 'ab'[: i % 3], rng.normal(0, 1e-3, 3), rng.integers(0, 4, 3))
        for i in range(30)
    ]
    seen = set()
    for block in reading_blocks([cdr.encode(message) for message in messages]):
        for i, row in enumerate(block.rows):
            assert block.displacement[i].tolist() == messages[row].displacement.tolist()
            assert block.status[i].tolist() == messages[row].status.tolist()
            assert block.stamp[i] == cdr.stamp_of(messages[row])
            seen.add(int(row))
    assert seen == set(range(30))


def test_the_other_byte_order_is_read_too():
    message = cdr.joint_state(7, 'base', NAMES[0], np.arange(3.0))
    store = cdr.typestore()
    big = bytes(store.serialize_cdr(message, JOINT_STATE, little_endian=False))
    assert big[:2] == b'\x00\x00'
    assert little_endian(JOINT_STATE, big) == cdr.encode(message)


@pytest.mark.parametrize('data', [b'', b'\x00\x01\x00\x00', b'\x00\x01' + bytes(40)])
def test_what_is_no_message_is_refused(data):
    reading = cdr.encode(cdr.displacements(1, 'p', np.zeros(3), np.zeros(3)))
    with pytest.raises(ValueError, match=f'not a {DISPLACEMENTS}'):
        list(reading_blocks([data[:20]]))
    for cut in (reading[:20], reading[:-1]):
        with pytest.raises(ValueError, match=f'not a {DISPLACEMENTS}'):
            list(reading_blocks([cut]))
