# SPDX-License-Identifier: Apache-2.0
"""Bags as other recorders leave them: topics in other encodings, DDS names, files nobody listed."""

import shutil
import struct
import time
from pathlib import Path

import pytest
import yaml
import zstandard
from mcap.reader import make_reader
from mcap.writer import Writer

from calib_model.bags import (
    cdr,
    left_aside,
    listed_topics,
    read_measurement,
    read_messages,
    recover,
)
from calib_model.errors import BagError
from calib_model.topics import CAPTURE_POSES, DESCRIPTIONS

pytestmark = pytest.mark.timeout(60)
DEMO = Path(__file__).resolve().parents[5] / 'bags/demo/identification'


def rewritten(path, encoding='cdr', type_of=lambda name: name, extra=('/operator', 'json')):
    """The demo's bag written by another recorder: a topic of its own beside ours."""
    with path.open('wb') as stream:
        writer = Writer(stream)
        writer.start(profile='', library='another')
        schema = writer.register_schema('Note', 'jsonschema', b'{}')
        other = writer.register_channel(extra[0], extra[1], schema)
        channels = {}
        for number, message in enumerate(read_messages(DEMO)):
            if message.topic not in channels:
                of = writer.register_schema(type_of(message.type), 'ros2msg', b'')
                mine = encoding if message.topic == CAPTURE_POSES.name else 'cdr'
                channels[message.topic] = writer.register_channel(message.topic, mine, of)
            if number % 50 == 0:
                writer.add_message(other, number, b'{"note": 1}', number)
            writer.add_message(
                channels[message.topic], message.log_time, message.data, message.publish_time
            )
        writer.finish()
    return path


@pytest.mark.parametrize('encoding', ['json', 'protobuf', 'ros1'])
def test_what_nobody_asked_for_may_be_in_any_encoding(tmp_path, encoding):
    bag = rewritten(tmp_path / 'bag.mcap', extra=('/operator', encoding))
    assert len(read_measurement(bag).poses) == 560
    # of all topics those are read that can be
    assert '/operator' not in {message.topic for message in read_messages(bag)}


def test_what_is_wanted_in_another_encoding_is_refused_by_name(tmp_path):
    bag = rewritten(tmp_path / 'bag.mcap', encoding='json')
    with pytest.raises(BagError, match=f"{CAPTURE_POSES.name} is encoded as 'json'"):
        read_measurement(bag)


def test_the_type_names_of_dds_are_understood(tmp_path):
    def dds(name):
        package, kind, own = name.split('/')
        return f'{package}::{kind}::dds_::{own}_'

    bag = rewritten(tmp_path / 'bag.mcap', type_of=dds)
    assert len(read_measurement(bag).poses) == 560


def folder_with(tmp_path, change):
    bag = tmp_path / 'bag'
    shutil.copytree(DEMO, bag)
    content = yaml.safe_load((bag / 'metadata.yaml').read_text())
    change(content['rosbag2_bagfile_information'], bag)
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(content))
    return bag


@pytest.mark.slow
def test_metadata_of_many_topics_is_read_in_no_time(tmp_path):
    def many(information, bag):
        row = information['topics_with_message_count'][0]
        profile = '- history: 1\n  depth: 10\n  reliability: 1\n' * 12
        information['topics_with_message_count'] += [
            {
                'topic_metadata': {
                    **row['topic_metadata'],
                    'name': f'/plant/sensor_{i}',
                    'offered_qos_profiles': profile,
                },
                'message_count': 0,
            }
            for i in range(700)
        ]

    bag = folder_with(tmp_path, many)
    assert (bag / 'metadata.yaml').stat().st_size > 400_000
    begun = time.process_time()
    assert len(read_measurement(bag).poses) == 560
    assert CAPTURE_POSES.name in listed_topics(bag)
    assert time.process_time() - begun < 20


def test_files_that_nobody_listed_are_named(tmp_path):
    def nothing(information, bag):
        (one,) = information['relative_file_paths']
        shutil.copy(bag / one, bag / 'shift_7.mcap')
        shutil.copy(bag / one, bag / f'{one}.zstd')  # the packing of one that is listed

    bag = folder_with(tmp_path, nothing)
    assert [file.name for file in left_aside(bag)] == ['shift_7.mcap']
    assert left_aside(DEMO) == left_aside(bag / 'shift_7.mcap') == []


def test_the_descriptions_are_read_from_such_bags_too(tmp_path):
    bag = rewritten(tmp_path / 'bag.mcap')
    told = {message.topic for message in read_messages(bag, {one.name for one in DESCRIPTIONS})}
    assert told == {one.name for one in DESCRIPTIONS}
    assert cdr.decode(DESCRIPTIONS[0].type, next(read_messages(bag, told)).data).data


def recorded_by_sqlite(folder, killed):
    """The demo's bag in SQLite's write-ahead log, `killed` before the log was put in its place."""
    import sqlite3

    folder.mkdir()
    base = sqlite3.connect(folder / 'rec_0.db3')
    base.execute('PRAGMA journal_mode=WAL')
    base.execute('PRAGMA wal_autocheckpoint=0')
    base.execute(
        'CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, '
        'serialization_format TEXT, offered_qos_profiles TEXT)'
    )
    base.execute(
        'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, '
        'data BLOB)'
    )
    numbers = {}
    for number, message in enumerate(read_messages(DEMO)):
        if message.topic not in numbers:
            numbers[message.topic] = len(numbers) + 1
            row = (numbers[message.topic], message.topic, message.type, 'cdr', '')
            base.execute('INSERT INTO topics VALUES (?, ?, ?, ?, ?)', row)
        row = (numbers[message.topic], message.log_time, message.data)
        base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)', row)
        if number == 200:
            base.commit()
            base.execute('PRAGMA wal_checkpoint')
    base.commit()
    if killed:
        shutil.copytree(folder, folder.with_name('killed'))
        base.close()
        return folder.with_name('killed')
    base.close()
    return folder


@pytest.mark.parametrize('killed', [False, True])
def test_the_journal_of_a_recorder_that_was_killed_is_read_and_left_alone(tmp_path, killed):
    bag = recorded_by_sqlite(tmp_path / 'bag', killed)
    assert (bag / 'rec_0.db3-wal').exists() == killed
    before = {file.name: file.read_bytes() for file in bag.iterdir()}
    assert len(read_measurement(bag).poses) == 560
    assert {file.name: file.read_bytes() for file in bag.iterdir()} == before


def test_a_wanted_topic_in_another_encoding_is_refused_of_sqlite_too(tmp_path):
    import sqlite3

    bag = recorded_by_sqlite(tmp_path / 'bag', killed=False)
    with sqlite3.connect(bag / 'rec_0.db3') as base:
        base.execute('UPDATE topics SET serialization_format = ?', ('json',))
    base.close()
    with pytest.raises(BagError, match="is encoded as 'json'"):
        read_measurement(bag)


def record(opcode, content):
    return struct.pack('<BQ', opcode, len(content)) + content


def text(value):
    return struct.pack('<I', len(value)) + value.encode()


def of_chunk(path, content, packed, compression):
    """An MCAP of one chunk, whose content is written as `packed`."""
    about = struct.pack('<QQQI', 0, 7, len(content), 0) + text(compression)
    chunk = record(6, about + struct.pack('<Q', len(packed)) + packed)
    magic, ends = b'\x89MCAP0\r\n', record(15, bytes(4)) + record(2, bytes(20))
    path.write_bytes(magic + record(1, text('') + text('another')) + chunk + ends + magic)
    return path


@pytest.mark.slow
def test_messages_beyond_number_in_a_small_file_are_refused_in_no_time(tmp_path):
    """Two million empty ones, on a topic that nobody asked for, pack into some kilobytes."""
    schema = record(3, struct.pack('<H', 1) + text('Note') + text('jsonschema') + text(''))
    channel = record(4, struct.pack('<HH', 1, 1) + text('/foo') + text('json') + text(''))
    messages = record(5, struct.pack('<HIQQ', 1, 0, 0, 0)) * 2_000_000
    content = schema + channel + messages
    packed = zstandard.compress(content)
    path = of_chunk(tmp_path / 'bag.mcap', content, packed, 'zstd')
    assert path.stat().st_size < 1_000_000
    begun = time.process_time()
    with pytest.raises(BagError, match='more than 1000000 messages in .* bytes'):
        read_measurement(path)
    assert time.process_time() - begun < 20


def two_recordings(tmp_path):
    """The first half of the demo in one file, the second half behind it, numbered anew."""
    halves = [tmp_path / f'{number}.mcap' for number in (1, 2)]
    messages = list(read_messages(DEMO))
    described = {one.name for one in DESCRIPTIONS}
    descriptions = [one for one in messages if one.topic in described]
    poses = [one for one in messages if one.topic == CAPTURE_POSES.name]
    for half, part in zip(halves, (poses[:200], poses[200:][::-1]), strict=True):
        with half.open('wb') as stream:
            writer = Writer(stream)
            writer.start(profile='ros2', library='another')
            channels = {}
            for one in [*part[:1], *descriptions, *part[1:]]:
                if one.topic not in channels:
                    schema = writer.register_schema(one.type, 'ros2msg', b'')
                    channels[one.topic] = writer.register_channel(one.topic, 'cdr', schema)
                writer.add_message(channels[one.topic], one.log_time, one.data, one.publish_time)
            writer.finish()
    both = tmp_path / 'both.mcap'
    both.write_bytes(halves[0].read_bytes() + halves[1].read_bytes())
    return both


def test_two_recordings_in_one_file_are_both_read_and_recovered(tmp_path):
    both = two_recordings(tmp_path)
    assert len(read_measurement(both).poses) == 560
    found = recover(both, tmp_path / 'copy')
    assert (found.messages, found.loss()) == (566, 'nothing')
    assert len(read_measurement(tmp_path / 'copy').poses) == 560


def test_what_is_behind_the_end_and_no_recording_is_named(tmp_path):
    bag = rewritten(tmp_path / 'bag.mcap')
    with bag.open('ab') as stream:
        stream.write(b'some text that was appended')
    with pytest.raises(BagError, match='behind its end there is more'):
        read_measurement(bag)
    found = recover(bag, tmp_path / 'copy')
    assert found.lossy and found.loss() == '27 bytes behind the end'
    assert len(read_measurement(tmp_path / 'copy').poses) == 560


def test_recovered_messages_keep_topic_type_and_encoding(tmp_path):
    """A number used again for another topic, two types on one topic, an encoding of another."""
    path = tmp_path / 'odd.mcap'
    note = record(3, struct.pack('<H', 1) + text('a/msg/Note') + text('ros2msg') + text(''))
    other = record(3, struct.pack('<H', 2) + text('a/msg/Other') + text('jsonschema') + text(''))

    def channel(number, schema, topic, encoding):
        return record(
            4, struct.pack('<HH', number, schema) + text(topic) + text(encoding) + text('')
        )

    def message(number, data):
        return record(5, struct.pack('<HIQQ', number, 0, 7, 7) + data)

    told = [('/one', 1, 'cdr'), ('/two', 2, 'json'), ('/two', 1, 'cdr'), ('/one', 1, 'cdr')]
    content = note + other
    for data, (topic, schema, encoding) in enumerate(told):
        content += channel(1, schema, topic, encoding) + message(1, bytes([data] * 4))
    of_chunk(path, content, content, '')
    found = recover(path, tmp_path / 'copy')
    assert (found.messages, found.loss()) == (4, 'nothing')
    with (tmp_path / 'copy/copy_0.mcap').open('rb') as stream:
        read = [
            (channel.topic, schema.name, channel.message_encoding, message.data[0])
            for schema, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]
    names = {1: 'a/msg/Note', 2: 'a/msg/Other'}
    expected = [(topic, names[schema], form, i) for i, (topic, schema, form) in enumerate(told)]
    assert sorted(read, key=lambda one: one[3]) == expected
