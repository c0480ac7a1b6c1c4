# SPDX-License-Identifier: Apache-2.0
"""Bags as other recorders leave them: topics in other encodings, DDS names, files nobody listed."""

import shutil
import time
from pathlib import Path

import pytest
import yaml
from mcap.writer import Writer

from calib_model.bags import cdr, left_aside, listed_topics, read_measurement, read_messages
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
