# SPDX-License-Identifier: Apache-2.0
"""Bags that no sound recorder writes: odd messages, odd types, records that swell."""

from __future__ import annotations

import random
import sqlite3
import struct
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.writer import CompressionType, Writer

from calib_model.bags import MAGIC, BagWriter, cdr, pose_message, read_messages, write_descriptions
from calib_model.descriptions import arm_yaml
from calib_model.measurement import Measurement
from calib_model.topics import (
    ARM_DESCRIPTION,
    CAPTURE_POSES,
    DESCRIPTIONS,
    JOINT_STATES,
    PROBE_DISPLACEMENTS,
)

NUMBERS = (np.nan, np.inf, -np.inf, 1e308, 1e17, 1e5, -1e-320, 0.0)
LENGTHS = (0, 1, 5, 7, 255, 1 << 16, 1_000_000, (1 << 31) - 1, 0xFFFFFFFF)
GIGABYTES = 4 << 30
TOPICS = (*DESCRIPTIONS, CAPTURE_POSES)


def pose_bytes(measured: Measurement, row: int) -> bytes:
    """The CDR bytes of a pose."""
    return cdr.encode(pose_message(measured, row))


def bytes_of(measured: Measurement, path: Path) -> bytes:
    """The file of a bag with a chunk after each pose, as a capture writes it."""
    with BagWriter(path) as bag:
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
        bag.flush()
        for row in range(len(measured.poses)):
            stamp = int(measured.poses.stamp[row])
            bag.write(CAPTURE_POSES, pose_bytes(measured, row), stamp, stamp)
            bag.flush()
    return (path / f'{path.name}_0.mcap').read_bytes()


def changed_message(data: bytes, rng: random.Random) -> bytes:
    """CDR bytes with a flip, another length, a number that is none, cut or with more behind."""
    changed = bytearray(data)
    at = rng.randrange(len(changed))
    kind = rng.choice(('flip', 'length', 'length', 'number', 'number', 'cut', 'more', 'order'))
    if kind == 'flip':
        changed[at] ^= 1 << rng.randrange(8)
    elif kind == 'length' and len(changed) >= 8:
        at = 4 * rng.randrange(1, len(changed) // 4)
        struct.pack_into('<I', changed, at, rng.choice(LENGTHS))
    elif kind == 'number' and len(changed) >= 20:
        at = 4 + 8 * rng.randrange(1, (len(changed) - 4) // 8)
        struct.pack_into('<d', changed, at, rng.choice(NUMBERS))
    elif kind == 'cut':
        del changed[at:]
    elif kind == 'more':
        changed += bytes(rng.randrange(1, 200))
    elif kind == 'order':
        changed[1] = rng.randrange(4)
    return bytes(changed)


def with_odd_messages(measured: Measurement, path: Path, rng: random.Random) -> None:
    """A sound MCAP whose poses or descriptions are not, or are called another type."""
    one = rng.random() < 0.5  # one of them, or all alike
    odd = rng.randrange(len(measured.poses))
    kind = rng.choice(('messages', 'messages', 'type', 'encoding', 'names', 'descriptions'))
    names = {topic.name: topic.type for topic in (*DESCRIPTIONS, CAPTURE_POSES)}
    if kind == 'type':
        names[rng.choice(list(names))] = rng.choice(
            ('', 'x', 'std_msgs/msg/Strin', 'sensor_msgs/msg/JointState', 'é/msg/É', 'a' * 5000)
        )
    encoding = rng.choice(('json', '', 'cdr ', 'é')) if kind == 'encoding' else 'cdr'
    seed = rng.random()
    with path.with_suffix('.mcap').open('wb') as stream:
        writer = Writer(stream, 4096, rng.choice(list(CompressionType)))
        writer.start('ros2')
        channels = {}
        for topic, type_name in names.items():
            schema = 0
            if kind != 'names' or rng.random() < 0.7:
                text = rng.choice((b'', b'\xff', b'string data'))
                schema = writer.register_schema(type_name, rng.choice(('ros2msg', 'x', '')), text)
            channels[topic] = writer.register_channel(
                topic,
                encoding,
                schema,
                {
                    'offered_qos_profiles': rng.choice(
                        ('', '[', '&a [*a]', '- {depth: x}', '[' * 5000)
                    )
                },
            )
        for topic, data in _descriptions(measured, path):
            if kind == 'descriptions' and rng.random() < 0.4:
                data = changed_message(data, rng)
            writer.add_message(channels[topic], 1, data, 1)
        for row in range(len(measured.poses)):
            data = pose_bytes(measured, row)
            if kind == 'messages' and (row == odd or not one):
                data = changed_message(data, random.Random(seed) if not one else rng)
            writer.add_message(channels[CAPTURE_POSES.name], 1, data, 1)
        writer.finish()
    path.with_suffix('.mcap').rename(path)


def _descriptions(measured: Measurement, path: Path) -> list[tuple[str, bytes]]:
    folder = path.with_name(f'{path.name}_descriptions')
    with BagWriter(folder) as bag:
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
    return [(message.topic, message.data) for message in read_messages(folder)]


def with_odd_raw_messages(measured: Measurement, path: Path, rng: random.Random) -> None:
    """Joint states and readings about each pose, some of them damaged, stamps of any kind."""
    start = rng.choice((0, 10**9, -(10**18), 2**31 * 10**9 - 10**11))
    names = list(measured.arm.joint_names)
    share = rng.choice((0.0, 0.01, 1.0))
    with BagWriter(path, chunk_size=1 << 20) as bag:
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
        for row in range(min(12, len(measured.poses))):
            for tick in range(40):
                stamp = start + (row * 40 + tick) * 10_000_000
                q = measured.poses.joints[row]
                state = cdr.joint_state(stamp, '', names, q)
                reading = cdr.displacements(
                    stamp, 'p', measured.poses.displacement[row], np.zeros(3)
                )
                for topic, message in ((JOINT_STATES, state), (PROBE_DISPLACEMENTS, reading)):
                    data = cdr.encode(message)
                    if rng.random() < share:
                        data = changed_message(data, rng)
                    bag.write(topic, data, max(0, stamp), max(0, stamp))


def _bag(path: Path, measured: Measurement, messages: list[tuple[Any, bytes]]) -> Path:
    with BagWriter(path, chunk_size=1 << 20) as bag:
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
        for topic, data in messages:
            bag.write(topic, data, 1, 1)
    return path


def _million_joints(measured: Measurement, folder: Path) -> Path:
    q = np.zeros(1_000_000)
    pose = cdr.encode(cdr.probing_pose(1, 'base_link', 1, 1, q, np.zeros(3), 1))
    return _bag(folder / 'joints', measured, [(CAPTURE_POSES, pose)] * 40)


def _million_names(measured: Measurement, folder: Path) -> Path:
    names = [f'joint_{i}' for i in range(1_000_000)]
    state = cdr.encode(cdr.joint_state(1, '', names, np.zeros(len(names))))
    reading = cdr.encode(cdr.displacements(1, 'p', np.zeros(3), np.zeros(3)))
    return _bag(folder / 'names', measured, [(JOINT_STATES, state), (PROBE_DISPLACEMENTS, reading)])


def _other_names_each_time(measured: Measurement, folder: Path) -> Path:
    reading = cdr.encode(cdr.displacements(1, 'p', np.zeros(3), np.zeros(3)))
    states = [
        cdr.encode(cdr.joint_state(i, '', [f'{i:06d}_{j}' for j in range(6)], np.zeros(6)))
        for i in range(10_000)
    ]
    messages = [(JOINT_STATES, state) for state in states] + [(PROBE_DISPLACEMENTS, reading)]
    return _bag(folder / 'other', measured, messages)


def _declared_lengths(measured: Measurement, folder: Path) -> Path:
    pose = bytearray(pose_bytes(measured, 0))
    struct.pack_into('<I', pose, pose.index(struct.pack('<I', measured.arm.n), 16), 0xFFFFFFFF)
    return _bag(folder / 'lengths', measured, [(CAPTURE_POSES, bytes(pose))] * 3)


def _huge_description(measured: Measurement, folder: Path) -> Path:
    text = arm_yaml(measured.arm) + '# ' + 'x' * 50_000_000
    messages = [(ARM_DESCRIPTION, cdr.encode(cdr.string(text)))]
    return _bag(folder / 'text', measured, [*messages, (CAPTURE_POSES, pose_bytes(measured, 0))])


def _zeros(compression: str, say_size: bool) -> bytes:
    """Four gigabytes of zeros, packed."""
    block = bytes(1 << 24)
    if compression == 'zstd':
        size = GIGABYTES if say_size else -1
        packer = zstandard.ZstdCompressor(level=1, write_content_size=say_size).compressobj(size)
        parts = [packer.compress(block) for _ in range(GIGABYTES >> 24)]
        return b''.join([*parts, packer.flush()])
    from lz4.frame import LZ4FrameCompressor

    packer = LZ4FrameCompressor()
    parts = [packer.begin(), *(packer.compress(block) for _ in range(GIGABYTES >> 24))]
    return b''.join([*parts, packer.flush()])


def _record(kind: int, content: bytes) -> bytes:
    return struct.pack('<BQ', kind, len(content)) + content


def _text(text: bytes) -> bytes:
    return struct.pack('<I', len(text)) + text


def _swelling_chunk(path: Path, compression: str, says: int, say_size: bool = True) -> Path:
    data = _zeros(compression, say_size)
    chunk = struct.pack('<QQQI', 0, 0, says, 0) + _text(compression.encode())
    chunk += struct.pack('<Q', len(data)) + data
    header = _record(1, _text(b'ros2') + _text(b'x'))
    path.write_bytes(MAGIC + header + _record(6, chunk))
    return path


def _record_without_end(measured: Measurement, folder: Path) -> Path:
    path = folder / 'record.mcap'
    path.write_bytes(MAGIC + struct.pack('<BQ', 5, 1 << 62) + bytes(1000))
    return path


BOMBS = {
    'poses of a million joints': _million_joints,
    'a joint state of a million names': _million_names,
    'other names in each joint state': _other_names_each_time,
    'a sequence that says it has four billion numbers': _declared_lengths,
    'a description of fifty megabytes': _huge_description,
    'a record without end': _record_without_end,
    'a zstd chunk of four gigabytes': lambda m, folder: _swelling_chunk(
        folder / 'a.mcap', 'zstd', GIGABYTES
    ),
    'one that says it has less': lambda m, folder: _swelling_chunk(folder / 'b.mcap', 'zstd', 99),
    'one that does not say': lambda m, folder: _swelling_chunk(
        folder / 'c.mcap', 'zstd', 99, say_size=False
    ),
    'an LZ4 chunk of four gigabytes': lambda m, folder: _swelling_chunk(
        folder / 'd.mcap', 'lz4', 99
    ),
}


def sqlite_bag(measured: Measurement, path: Path) -> bytes:
    """The file of the measurement as rosbag2's other storage keeps it."""
    with closing(sqlite3.connect(path)) as base, base:
        base.execute(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format, '
            'offered_qos_profiles)'
        )
        base.execute('CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data)')
        numbers = {}
        for number, topic in enumerate((*DESCRIPTIONS, CAPTURE_POSES), start=1):
            numbers[topic.name] = number
            row = (number, topic.name, topic.type, 'cdr', '')
            base.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?)', row)
        messages = _descriptions(measured, path)
        messages += [
            (CAPTURE_POSES.name, pose_bytes(measured, row)) for row in range(len(measured.poses))
        ]
        for stamp, (name, data) in enumerate(messages):
            row = (numbers[name], stamp, data)
            base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', row)
    return path.read_bytes()


def change_a_cell(file: Path, rng: random.Random) -> None:
    """One cell of an SQLite bag gets a value of another kind."""
    table, columns = rng.choice(
        (
            ('topics', ('name', 'type', 'serialization_format', 'offered_qos_profiles')),
            ('messages', ('topic_id', 'timestamp', 'data')),
        )
    )
    value = rng.choice((None, 10**12, -1, 1.5, 'text', b'\xff\xfe', b'', 'x' * 10_000))
    with closing(sqlite3.connect(file)) as base, base:
        column = rng.choice(columns)
        base.execute(f'UPDATE {table} SET {column} = ? WHERE id = ?', (value, rng.randrange(1, 5)))
