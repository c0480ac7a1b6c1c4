# SPDX-License-Identifier: Apache-2.0
"""Our bags in readers nobody here wrote, and bags nobody here wrote in our reader."""

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from calib_model.bags import (
    BagWriter,
    FileAccount,
    cdr,
    pose_message,
    read_measurement,
    read_messages,
    write_descriptions,
    write_measurement,
)
from calib_model.descriptions import arm_yaml, gauge_yaml, parse_arm, probe_yaml
from calib_model.errors import BagError
from calib_model.instruments import Gauge, trihedron
from calib_model.measurement import Measurement, ProbingSet
from calib_model.topics import (
    CAPTURE_POSES,
    DESCRIPTIONS,
    JOINT_STATES,
    PROBE_DISPLACEMENTS,
    STRING,
)
from calib_model.transforms import RigidTransform

START = 1_700_000_000_000_000_000
COUNT = 30


@pytest.fixture(scope='module')
def measured() -> Measurement:
    rng = np.random.default_rng(8)
    joint = '{name: j%d, a: 0.1, alpha: 0.2, d: 0.3, theta_0: 0.4}'
    arm = parse_arm(f'name: two\njoints: [{joint % 1}, {joint % 2}]')
    probe = trihedron(RigidTransform(np.array([0.0, 0.0, 0.1])))
    gauge = Gauge('bar', 0.022, ((1, (0.0, 0.0, 0.0)), (6, (0.5, 0.0, 0.0))), 1e-6, 1e-6)
    readings = probe.displacements(rng.uniform(-1e-3, 1e-3, (COUNT, 3)), 0.022)
    poses = ProbingSet(
        np.repeat([1, 2, 3], COUNT // 3),
        np.tile([1, 6], COUNT // 2),
        rng.uniform(-3, 3, (COUNT, 2)),
        readings,
        START + np.arange(COUNT) * 10**7 + 3,
        np.arange(COUNT) + 1,
    )
    return Measurement(arm, probe, gauge, poses).checked()


@pytest.fixture(scope='module')
def bag(measured: Measurement, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('ours') / 'bag'
    write_measurement(path, measured)
    return path


@pytest.fixture(scope='module')
def raw_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of the streams, best-effort readings among them, written while it is flushed."""
    path = tmp_path_factory.mktemp('raw') / 'bag'
    with BagWriter(path) as writer:
        for i in range(COUNT):
            state = cdr.joint_state(START + i, 'base', ['j1', 'j2'], np.array([i, -i]))
            writer.write_message(JOINT_STATES, state, START + i)
            status = np.array([0, 1, 2])
            reading = cdr.displacements(START + i, 'probe', np.full(3, i * 1e-5), status)
            writer.write_message(PROBE_DISPLACEMENTS, reading, START + i)
            writer.flush()
    return path


def check_pose(pose: object, measured: Measurement, i: int) -> None:
    poses = measured.poses
    assert (pose.location, pose.sphere) == (poses.location[i], poses.sphere[i])
    assert np.array(pose.joint_position).tobytes() == poses.joints[i].tobytes()
    assert np.array(pose.displacement).tobytes() == poses.displacement[i].tobytes()
    assert pose.readings == poses.readings[i]
    assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == poses.stamp[i]
    assert pose.header.frame_id == 'base_link'


def check_descriptions(texts: dict[str, str], measured: Measurement) -> None:
    ours = (arm_yaml(measured.arm), probe_yaml(measured.probe), gauge_yaml(measured.gauge))
    assert texts == {topic.name: text for topic, text in zip(DESCRIPTIONS, ours, strict=True)}


def test_rosbags_reads_a_measurement(bag: Path, measured: Measurement) -> None:
    texts, number = {}, 0
    with AnyReader([bag]) as reader:  # types from the bag alone: none given
        assert reader.message_count == COUNT + 3
        for connection, time, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic == CAPTURE_POSES.name:
                check_pose(message, measured, number)
                assert time == measured.poses.stamp[number]
                number += 1
            else:
                texts[connection.topic] = message.data
    assert number == COUNT
    check_descriptions(texts, measured)


def test_rosbags_reads_the_streams(raw_bag: Path) -> None:
    with AnyReader([raw_bag]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        assert counts == {JOINT_STATES.name: COUNT, PROBE_DISPLACEMENTS.name: COUNT}
        for i, (connection, _, data) in enumerate(
            reader.messages([c for c in reader.connections if 'probe' in c.topic])
        ):
            reading = reader.deserialize(data, connection.msgtype)
            assert reading.displacement.tolist() == [i * 1e-5] * 3
            assert reading.status.tolist() == [0, 1, 2]
            assert (reading.OVER_TRAVEL, reading.WEAK_SIGNAL) == (2, 3)
        assert i == COUNT - 1


def test_mcap_ros2_reads_a_measurement(bag: Path, measured: Measurement) -> None:
    texts, number = {}, 0
    with (bag / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, record, message in reader.iter_decoded_messages():
            if channel.topic == CAPTURE_POSES.name:
                check_pose(message, measured, number)
                assert record.log_time == measured.poses.stamp[number]
                number += 1
            else:
                texts[channel.topic] = message.data
    assert number == COUNT
    check_descriptions(texts, measured)


def test_mcap_reads_the_streams_by_index(raw_bag: Path) -> None:
    with (raw_bag / 'bag_0.mcap').open('rb') as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == 'ros2'
        window = reader.iter_decoded_messages(
            topics=PROBE_DISPLACEMENTS.name, starting_at=START + 10, ending_before=START + 20
        )
        found = [message.displacement[0] for _, _, _, message in window]
    assert found == [i * 1e-5 for i in range(10, 20)]


def written_by_rosbags(
    path: Path,
    measured: Measurement,
    mode: CompressionMode | None = None,
    plugin: StoragePlugin = StoragePlugin.MCAP,
) -> Path:
    """The measurement as rosbags' own writer puts it on disk."""
    store, poses = cdr.typestore(), measured.poses
    writer = Writer(path, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        texts = (arm_yaml(measured.arm), probe_yaml(measured.probe), gauge_yaml(measured.gauge))
        for topic, text in zip(DESCRIPTIONS, texts, strict=True):
            connection = writer.add_connection(topic.name, STRING, typestore=store)
            data = store.serialize_cdr(cdr.string(text), STRING)
            writer.write(connection, START, data)
        kind = CAPTURE_POSES.type
        connection = writer.add_connection(CAPTURE_POSES.name, kind, typestore=store)
        for i in range(len(poses)):
            pose = cdr.probing_pose(
                int(poses.stamp[i]),
                'base_link',
                int(poses.location[i]),
                int(poses.sphere[i]),
                poses.joints[i],
                poses.displacement[i],
                int(poses.readings[i]),
            )
            writer.write(connection, int(poses.stamp[i]), store.serialize_cdr(pose, kind))
    return path


WRITTEN = [
    (plugin, mode)
    for plugin in StoragePlugin
    for mode in (None, *CompressionMode)
    if mode is not CompressionMode.NONE
    and (plugin is StoragePlugin.MCAP or mode is not CompressionMode.STORAGE)
]


@pytest.mark.parametrize(('plugin', 'mode'), WRITTEN)
@pytest.mark.parametrize('listed', [True, False])
def test_bags_of_rosbags_are_read_here(
    tmp_path: Path,
    measured: Measurement,
    mode: CompressionMode | None,
    plugin: StoragePlugin,
    listed: bool,
) -> None:
    """MCAP and SQLite, compressed within, around or message by message, with and without a list."""
    path = written_by_rosbags(tmp_path / 'theirs', measured, mode, plugin)
    if not listed:
        (path / 'metadata.yaml').unlink()
    found = read_measurement(path)
    assert found.arm == measured.arm
    assert found.gauge == measured.gauge
    for column in ('location', 'sphere', 'joints', 'displacement', 'stamp', 'readings'):
        theirs, ours = getattr(found.poses, column), getattr(measured.poses, column)
        assert theirs.tobytes() == ours.tobytes(), column


@pytest.mark.parametrize('plugin', list(StoragePlugin))
def test_a_compressed_file_that_is_damaged_is_named(
    tmp_path: Path, measured: Measurement, plugin: StoragePlugin
) -> None:
    path = written_by_rosbags(tmp_path / 'theirs', measured, CompressionMode.FILE, plugin)
    (file,) = path.glob('*.zstd')
    whole = file.read_bytes()
    file.write_bytes(whole[:40] + bytes(60) + whole[100:])
    with pytest.raises(BagError, match=r'theirs_?0?\.(mcap|db3)\.zstd: '):
        read_measurement(path)


def test_a_bag_split_into_files_is_read_in_their_order(
    tmp_path: Path, measured: Measurement
) -> None:
    """As rosbag2 splits: each file whole, all of them listed."""
    folder, poses = tmp_path / 'split', measured.poses
    accounts: list[FileAccount] = []
    for part in np.array_split(np.arange(COUNT), 3):
        with BagWriter(folder, earlier=accounts) as writer:
            write_descriptions(writer, measured.arm, measured.probe, measured.gauge, START)
            for i in part:
                writer.write_message(CAPTURE_POSES, pose_message(measured, i), int(poses.stamp[i]))
            writer.flush()
            accounts.append(writer.close())
    assert len(list(folder.glob('*.mcap'))) == 3
    assert read_measurement(folder).poses.stamp.tolist() == poses.stamp.tolist()


def test_a_bag_cut_short_is_read_here_and_its_copy_everywhere(
    bag: Path, measured: Measurement, tmp_path: Path
) -> None:
    whole = (bag / 'bag_0.mcap').read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole[: len(whole) - 200])  # the index is gone, the chunks are there
    found = read_measurement(cut)
    assert len(found.poses) == COUNT
    write_measurement(tmp_path / 'copy', found)
    with AnyReader([tmp_path / 'copy']) as reader:
        assert reader.message_count == COUNT + 3
    assert len(list(read_messages(tmp_path / 'copy'))) == COUNT + 3
