# SPDX-License-Identifier: Apache-2.0
"""Recovery of bags in SQLite: each message keeps topic, type and encoding, what is lost is said."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from mcap.reader import make_reader

from calib_model.bags import recover

pytestmark = pytest.mark.timeout(60)
FLOAT = b'\0\1\0\0' + bytes(8)
TOPICS = (
    (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr'),
    (2, '/own', 'my_msgs/msg/Own', 'cdr'),
    (3, '/log', 'plain', 'json'),
    (4, '/own', 'std_msgs/msg/Float64', 'cdr'),
)


def bag(path: Path, rows: int = 900) -> Path:
    path.mkdir()
    with sqlite3.connect(path / 'rec_0.db3') as base:
        base.execute('PRAGMA page_size=1024')
        base.execute(
            'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
            'serialization_format TEXT, offered_qos_profiles TEXT)'
        )
        base.execute(
            'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, '
            'timestamp INTEGER, data BLOB)'
        )
        base.executemany('INSERT INTO topics VALUES(?, ?, ?, ?, "")', TOPICS)
        base.executemany(
            'INSERT INTO messages VALUES(?, ?, ?, ?)',
            [
                (n, 1 + n % 4, 7_000 + n, b'{"a": 1}' if n % 4 == 2 else FLOAT + bytes([n % 251]))
                for n in range(1, rows + 1)
            ],
        )
    base.close()
    return path


def read(path: Path) -> list[tuple[str, str, str, int, bytes]]:
    with next(path.glob('*.mcap')).open('rb') as stream:
        return [
            (channel.topic, schema.name, channel.message_encoding, message.log_time, message.data)
            for schema, channel, message in make_reader(stream).iter_messages()
        ]


def test_every_message_comes_back_with_its_topic_type_and_encoding(tmp_path):
    found = recover(bag(tmp_path / 'bag'), tmp_path / 'out')
    assert not found.lossy and found.loss() == 'nothing'
    back = read(tmp_path / 'out')
    assert len(back) == 900
    for topic, kind, encoding, time, data in back:
        number = time - 7_000
        assert (topic, kind, encoding) == TOPICS[number % 4][1:]
        assert data == (b'{"a": 1}' if number % 4 == 2 else FLOAT + bytes([number % 251]))


def test_rows_that_are_gone_and_pages_that_are_damaged_are_told(tmp_path):
    with sqlite3.connect(bag(tmp_path / 'gone') / 'rec_0.db3') as base:
        base.execute('DELETE FROM messages WHERE id BETWEEN 100 AND 116')
    base.close()
    found = recover(tmp_path / 'gone', tmp_path / 'out')
    assert found.lossy and found.loss() == '17 messages known to be missing'
    file = bag(tmp_path / 'torn', 3000) / 'rec_0.db3'
    content = bytearray(file.read_bytes())
    middle = len(content) // 2048 * 1024
    content[middle : middle + 1024] = b'\xee' * 1024
    file.write_bytes(content)
    found = recover(tmp_path / 'torn', tmp_path / 'mended')
    assert found.lossy and 'known to be missing' in found.loss()
    times = [row[3] - 7_000 for row in read(tmp_path / 'mended')]
    assert times[0] == 1 and times[-1] == 3000 and len(times) > 2900
    assert len(times) + found.lost == 3000
