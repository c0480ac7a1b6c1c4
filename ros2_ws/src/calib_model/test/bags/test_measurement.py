# SPDX-License-Identifier: Apache-2.0
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader

from calib_model.bags import cdr
from calib_model.bags.measurement import read_measurement
from calib_model.bags.measurement_writer import write_descriptions, write_measurement
from calib_model.bags.reader import read_messages
from calib_model.bags.writer import BagWriter
from calib_model.descriptions import gauge_yaml
from calib_model.errors import BagError, DataError, DescriptionError
from calib_model.measurement import Measurement
from calib_model.topics import (
    ARM_DESCRIPTION,
    CAPTURE_POSES,
    GAUGE_DESCRIPTION,
    JOINT_STATES,
    PROBE_DISPLACEMENTS,
)


def assert_same(found: Measurement, expected: Measurement) -> None:
    assert found.arm == expected.arm
    assert found.gauge == expected.gauge
    assert found.probe.styli == expected.probe.styli
    for column in fields(expected.poses):
        theirs, ours = getattr(found.poses, column.name), getattr(expected.poses, column.name)
        assert theirs.tobytes() == ours.tobytes(), column.name


def test_a_measurement_comes_back_bit_for_bit(measured: Measurement, tmp_path: Path) -> None:
    write_measurement(tmp_path / 'bag', measured)
    assert_same(read_measurement(tmp_path / 'bag'), measured)
    assert_same(read_measurement(tmp_path / 'bag' / 'bag_0.mcap'), measured)
    (tmp_path / 'bag' / 'metadata.yaml').unlink()
    assert_same(read_measurement(tmp_path / 'bag'), measured)


def test_stamps_from_before_1970_come_back_too(measured: Measurement, tmp_path: Path) -> None:
    early = replace(measured.poses, stamp=measured.poses.stamp - measured.poses.stamp[0] - 7)
    write_measurement(tmp_path / 'bag', replace(measured, poses=early))
    assert_same(read_measurement(tmp_path / 'bag'), replace(measured, poses=early))


def test_a_description_given_takes_the_place_of_the_bags(
    measured: Measurement, tmp_path: Path
) -> None:
    write_measurement(tmp_path / 'bag', measured)
    other = replace(measured.arm, name='another')
    assert read_measurement(tmp_path / 'bag', arm=other).arm == other


def test_a_bag_is_never_overwritten(measured: Measurement, tmp_path: Path) -> None:
    write_measurement(tmp_path / 'bag', measured)
    with pytest.raises(BagError, match='exists already, a bag is never overwritten'):
        write_measurement(tmp_path / 'bag', measured)
    assert_same(read_measurement(tmp_path / 'bag'), measured)


def test_an_unwritable_place_is_named(measured: Measurement, tmp_path: Path) -> None:
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError, match='cannot be written: Not a directory'):
        write_measurement(tmp_path / 'file' / 'bag', measured)


def test_the_same_measurement_makes_the_same_bytes(measured: Measurement, tmp_path: Path) -> None:
    for folder in ('one', 'two'):
        write_measurement(tmp_path / folder / 'bag', measured)
    for name in ('bag_0.mcap', 'metadata.yaml'):
        one, two = (tmp_path / folder / 'bag' / name for folder in ('one', 'two'))
        assert one.read_bytes() == two.read_bytes()


def test_metadata_says_what_the_file_holds(measured: Measurement, tmp_path: Path) -> None:
    write_measurement(tmp_path / 'bag', measured)
    text = (tmp_path / 'bag' / 'metadata.yaml').read_text()
    information = yaml.safe_load(text)['rosbag2_bagfile_information']
    count, stamp = len(measured.poses), measured.poses.stamp
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['message_count'] == count + 3
    assert information['relative_file_paths'] == ['bag_0.mcap']
    assert information['starting_time']['nanoseconds_since_epoch'] == stamp.min()
    assert information['duration']['nanoseconds'] == stamp.max() - stamp.min()
    topics = {
        row['topic_metadata']['name']: (row['topic_metadata'], row['message_count'])
        for row in information['topics_with_message_count']
    }
    assert topics['/capture/poses'][1] == count
    with (tmp_path / 'bag' / 'bag_0.mcap').open('rb') as stream:
        summary = make_reader(stream).get_summary()
    for channel in summary.channels.values():
        metadata, number = topics.pop(channel.topic)
        qos = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        assert qos == metadata['offered_qos_profiles']
        assert channel.metadata['topic_type_hash'] == metadata['type_description_hash']
        assert summary.schemas[channel.schema_id].name == metadata['type']
        assert summary.schemas[channel.schema_id].encoding == 'ros2msg'
        assert summary.statistics.channel_message_counts[channel.id] == number
    assert not topics


def test_what_was_flushed_is_there_without_a_close(measured: Measurement, tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / 'bag')
    write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
    pose = cdr.probing_pose(5, 'base', 1, 6, np.zeros(6), np.zeros(3), 1)
    bag.write_message(CAPTURE_POSES, pose, 5)
    bag.flush()
    bag.write_message(CAPTURE_POSES, pose, 6)
    assert len(read_measurement(tmp_path / 'bag').poses) == 1
    bag.close()
    bag.close()
    assert len(read_measurement(tmp_path / 'bag').poses) == 2


def test_messages_carry_topic_times_and_qos(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        state = cdr.joint_state(3, '', ['a'], np.zeros(1))
        bag.write(JOINT_STATES, cdr.encode(state), 7, 3)
        reading = cdr.displacements(4, 'probe', np.zeros(3), np.zeros(3))
        bag.write_message(PROBE_DISPLACEMENTS, reading, 8)
    first, second = read_messages(tmp_path / 'bag')
    assert (first.topic, first.type) == ('/joint_states', 'sensor_msgs/msg/JointState')
    assert (first.log_time, first.publish_time, first.data) == (7, 3, cdr.encode(state))
    assert yaml.safe_load(first.offered_qos)[0]['reliability'] == 'reliable'
    assert yaml.safe_load(second.offered_qos)[0]['reliability'] == 'best_effort'
    (only,) = read_messages(tmp_path / 'bag', {'/joint_states'})
    assert only == first


def described(tmp_path: Path, measured: Measurement) -> BagWriter:
    bag = BagWriter(tmp_path / 'bag')
    write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
    return bag


def test_what_is_missing_is_named(measured: Measurement, tmp_path: Path) -> None:
    with pytest.raises(BagError, match='none: no such bag'):
        read_measurement(tmp_path / 'none')
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagError, match=r'empty: no \.mcap file in this folder'):
        read_measurement(tmp_path / 'empty')
    described(tmp_path, measured).close()
    with pytest.raises(BagError, match='no messages on /capture/poses'):
        read_measurement(tmp_path / 'bag')
    with BagWriter(tmp_path / 'poses') as bag:
        pose = cdr.probing_pose(5, 'base', 1, 6, np.zeros(6), np.zeros(3), 1)
        bag.write_message(CAPTURE_POSES, pose, 5)
    with pytest.raises(BagError, match='no topic /arm_description'):
        read_measurement(tmp_path / 'poses')
    (tmp_path / 'bag' / 'bag_0.mcap').unlink()
    with pytest.raises(BagError, match=r'metadata\.yaml names bag_0\.mcap, which is missing'):
        read_measurement(tmp_path / 'bag')
    (tmp_path / 'bag' / 'metadata.yaml').write_text('[')
    with pytest.raises(BagError, match=r'metadata\.yaml: not a rosbag2 metadata file'):
        read_measurement(tmp_path / 'bag')


def test_a_description_that_cannot_be_used_is_named(measured: Measurement, tmp_path: Path) -> None:
    with described(tmp_path, measured) as bag:
        bag.write_message(GAUGE_DESCRIPTION, cdr.string('name: bar\n'), 2)
        pose = cdr.probing_pose(5, 'base', 1, 6, np.zeros(6), np.zeros(3), 1)
        bag.write_message(CAPTURE_POSES, pose, 5)
    with pytest.raises(DescriptionError, match='/gauge_description: missing key'):
        read_measurement(tmp_path / 'bag')


def test_a_description_that_changes_within_a_bag_is_refused(
    measured: Measurement, tmp_path: Path
) -> None:
    pose = cdr.probing_pose(5, 'base', 1, 6, np.zeros(6), np.zeros(3), 1)
    other = replace(measured.gauge, sphere_diameter=0.0221)
    text = gauge_yaml(measured.gauge)
    for name, said in (
        ('same', text),
        ('in other words', f'# as before\n{text}'),
        ('other', gauge_yaml(other)),
    ):
        with described(tmp_path / name, measured) as bag:
            bag.write_message(CAPTURE_POSES, pose, 5)
            bag.write_message(GAUGE_DESCRIPTION, cdr.string(said), 6)
            bag.write_message(CAPTURE_POSES, pose, 7)
    for name in ('same', 'in other words'):
        assert read_measurement(tmp_path / name / 'bag').gauge == measured.gauge
    with pytest.raises(BagError, match='bag: /gauge_description changes within the bag: which'):
        read_measurement(tmp_path / 'other' / 'bag')
    given = read_measurement(tmp_path / 'other' / 'bag', gauge=other)
    assert (given.gauge, len(given.poses)) == (other, 2)


def test_a_topic_of_another_type_is_named(measured: Measurement, tmp_path: Path) -> None:
    with described(tmp_path, measured) as bag:
        bag.write_message(replace(CAPTURE_POSES, type=ARM_DESCRIPTION.type), cdr.string('x'), 2)
    with pytest.raises(BagError, match=r'topic /capture/poses has type std_msgs/msg/String, not'):
        read_measurement(tmp_path / 'bag')


def test_a_message_that_is_not_one_is_named(measured: Measurement, tmp_path: Path) -> None:
    with described(tmp_path, measured) as bag:
        bag.write(CAPTURE_POSES, b'\x00\x01\x00\x00short', 2, 2)
    with pytest.raises(BagError, match='/capture/poses, message 1: not a calib_interfaces/msg'):
        read_measurement(tmp_path / 'bag')


def test_poses_of_two_arms_in_one_bag_are_refused(measured: Measurement, tmp_path: Path) -> None:
    with described(tmp_path, measured) as bag:
        for n in (6, 7):
            pose = cdr.probing_pose(5, 'base', 1, 6, np.zeros(n), np.zeros(3), 1)
            bag.write_message(CAPTURE_POSES, pose, 5)
    with pytest.raises(BagError, match='pose 2 has 7 joint positions, the first has 6'):
        read_measurement(tmp_path / 'bag')


def test_a_pose_that_is_no_number_is_refused(measured: Measurement, tmp_path: Path) -> None:
    with described(tmp_path, measured) as bag:
        pose = cdr.probing_pose(5, 'base', 1, 6, np.full(6, np.nan), np.zeros(3), 1)
        bag.write_message(CAPTURE_POSES, pose, 5)
    with pytest.raises(DataError, match='pose 1 .* has a joint that is not finite'):
        read_measurement(tmp_path / 'bag')


@pytest.mark.parametrize('text', ['[]', 'x: 1', 'rosbag2_bagfile_information: [1]', '3', '\x00'])
def test_metadata_of_any_other_kind_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / 'metadata.yaml').write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml: not a rosbag2 metadata file'):
        read_measurement(tmp_path)


def test_metadata_that_lists_a_file_twice_does_not_double_its_poses(
    measured: Measurement, tmp_path: Path
) -> None:
    write_measurement(tmp_path / 'bag', measured)
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    listed = '- bag_0.mcap'
    text = metadata.read_text().replace(listed, f'{listed}\n  {listed}', 1)
    metadata.write_text(text)
    with pytest.raises(BagError, match=r'metadata\.yaml: lists bag_0\.mcap twice'):
        read_measurement(tmp_path / 'bag')
