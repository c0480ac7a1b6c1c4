# SPDX-License-Identifier: Apache-2.0
"""What comes back of a bag that was cut or damaged: every complete chunk, and a true account."""

import os
from pathlib import Path

import pytest

from calib_model.bags import cdr
from calib_model.bags.measurement_writer import pose_message, write_descriptions
from calib_model.bags.reader import BagMessage, read_messages
from calib_model.bags.recovery import recover, repair
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError
from calib_model.measurement import Measurement
from calib_model.topics import CAPTURE_POSES

pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def whole(measured: Measurement, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag with a chunk after every pose."""
    path = tmp_path_factory.mktemp('bags') / 'bag'
    poses = measured.poses
    with BagWriter(path) as writer:
        writer.note('settings', {'settle': '0.01'})
        write_descriptions(writer, measured.arm, measured.probe, measured.gauge, 1)
        writer.flush()
        for i in range(len(poses)):
            writer.write_message(CAPTURE_POSES, pose_message(measured, i), int(poses.stamp[i]))
            writer.flush()
    return path


def messages(path: Path) -> list[BagMessage]:
    return list(read_messages(path))


def cut(whole: Path, tmp_path: Path, end: int) -> Path:
    """The bag as a kill leaves it: its first `end` bytes, its first metadata."""
    folder = tmp_path / 'cut'
    folder.mkdir()
    (folder / 'cut_0.mcap').write_bytes((whole / 'bag_0.mcap').read_bytes()[:end])
    return folder


@pytest.mark.parametrize('share', [0.2, 0.3, 0.41, 0.5, 0.57, 0.63])
def test_every_complete_chunk_of_a_cut_bag_comes_back(
    share: float, whole: Path, tmp_path: Path
) -> None:
    size = (whole / 'bag_0.mcap').stat().st_size
    bad = cut(whole, tmp_path, int(share * size))
    there = messages(bad)  # the reader of cut bags, which other tests hold to its word
    found = recover(bad, tmp_path / 'out')
    assert messages(tmp_path / 'out') == there == messages(whole)[: len(there)]
    assert found.messages == len(there) < len(messages(whole))
    assert found.lossy
    assert 'no end of the recording' in found.loss()
    list(read_messages(tmp_path / 'out', cut_allowed=False))


def test_nothing_is_missing_of_a_whole_bag_nor_of_one_without_its_index(
    whole: Path, tmp_path: Path
) -> None:
    size = (whole / 'bag_0.mcap').stat().st_size
    for number, bad in enumerate((whole, cut(whole, tmp_path, size - 9))):
        found = recover(bad, tmp_path / f'out{number}')
        assert not found.lossy
        assert found.loss() == 'nothing'
        assert messages(tmp_path / f'out{number}') == messages(whole)


def test_a_damaged_chunk_costs_its_own_messages_only_and_they_are_counted(
    whole: Path, tmp_path: Path
) -> None:
    expected = messages(whole)
    content = bytearray((whole / 'bag_0.mcap').read_bytes())
    content[len(content) // 3] ^= 0xFF  # within a chunk: they fill the file
    bad = cut(whole, tmp_path, 0)
    (bad / 'cut_0.mcap').write_bytes(content)
    found = recover(bad, tmp_path / 'out')
    assert found.damaged_chunks == 1
    assert found.lost == 1
    assert found.lossy
    there = messages(tmp_path / 'out')
    assert len(there) == len(expected) - 1
    assert set(there) < set(expected)


def test_types_of_others_come_back_with_their_text(whole: Path, tmp_path: Path) -> None:
    recover(whole, tmp_path / 'copy')
    reader = pytest.importorskip('mcap.reader')
    for path in (whole / 'bag_0.mcap', tmp_path / 'copy' / 'copy_0.mcap'):
        with path.open('rb') as stream:
            made = reader.make_reader(stream)
            summary = made.get_summary()
            notes = [record.metadata for record in made.iter_metadata()]
        schemas = {each.name: each.data for each in summary.schemas.values()}
        assert schemas['calib_interfaces/msg/ProbingPose'] == cdr.schema_text(CAPTURE_POSES.type)
        assert notes == [{'settle': '0.01'}]


def test_a_bag_without_a_complete_chunk_is_refused_and_nothing_is_made(
    whole: Path, tmp_path: Path
) -> None:
    with pytest.raises(BagError, match='nothing can be recovered'):
        recover(cut(whole, tmp_path, 300), tmp_path / 'out')
    assert sorted(path.name for path in tmp_path.iterdir()) == ['cut']
    with pytest.raises(BagError, match='exists already'):
        recover(whole, tmp_path / 'cut')


def test_a_repaired_bag_goes_on_in_a_further_file_and_reads_as_one(
    whole: Path, tmp_path: Path, measured: Measurement
) -> None:
    size = (whole / 'bag_0.mcap').stat().st_size
    bad = cut(whole, tmp_path, size // 2)
    before = messages(bad)
    (bad / 'cut_1.mcap').write_bytes(b'')  # as a kill before its first chunk leaves it
    files = repair(bad)
    assert [file.name for file in files] == ['cut_0.mcap']
    assert messages(bad) == before
    rest = messages(whole)[len(before) :]
    with BagWriter(bad, earlier=files) as writer:
        assert messages(bad) == before  # what is not yet readable is not yet listed
        for message in rest:
            writer.write(CAPTURE_POSES, message.data, message.log_time, message.publish_time)
            writer.flush()
            assert messages(bad)[-1] == message
    assert messages(bad) == messages(whole)
    assert [file.name for file in repair(bad)] == ['cut_0.mcap', 'cut_1.mcap']


def test_other_readers_take_a_bag_of_several_files(whole: Path, tmp_path: Path) -> None:
    rosbags = pytest.importorskip('rosbags.highlevel')
    bad = cut(whole, tmp_path, (whole / 'bag_0.mcap').stat().st_size // 2)
    files = repair(bad)
    rest = messages(whole)[sum(file.messages for file in files) :]
    with BagWriter(bad, earlier=files) as writer:
        for message in rest:
            writer.write(CAPTURE_POSES, message.data, message.log_time, message.publish_time)
    with rosbags.AnyReader([bad]) as reader:
        data = [bytes(data) for _, _, data in reader.messages()]
    assert sorted(data) == sorted(message.data for message in messages(whole))


def test_a_bag_killed_before_its_first_chunk_makes_way_for_a_new_one(
    whole: Path, tmp_path: Path
) -> None:
    bad = cut(whole, tmp_path, 200)
    (bad / 'metadata.yaml').write_text('')
    for left in ('.repair-old', '.repair.999999-7.part'):  # killed as they repaired it
        (bad / left / 'copy').mkdir(parents=True)
    assert repair(bad) == []
    assert not bad.exists()
    with pytest.raises(BagError, match='no such bag'):
        repair(bad)


@pytest.mark.parametrize('name', ['bag_0.mcap', 'bag_1.mcap', 'metadata.yaml'])
def test_a_pipe_among_the_files_is_named_and_not_waited_for(
    name: str, whole: Path, tmp_path: Path
) -> None:
    bad = tmp_path / 'bad'
    bad.mkdir()
    if name != 'bag_0.mcap':
        (bad / 'bag_0.mcap').write_bytes((whole / 'bag_0.mcap').read_bytes())
    os.mkfifo(bad / name)
    for use in (lambda: recover(bad, tmp_path / 'out'), lambda: list(read_messages(bad))):
        try:
            use()
        except BagError as error:
            assert f'{bad / name}: ' in str(error)
        else:  # what metadata.yaml would have said the files say themselves
            assert name == 'metadata.yaml'
    assert name == 'metadata.yaml' or not (tmp_path / 'out').exists()


def test_a_file_that_held_something_is_never_taken_away(whole: Path, tmp_path: Path) -> None:
    bad = cut(whole, tmp_path, 0)
    (bad / 'cut_0.mcap').write_bytes(bytes(100_000))
    with pytest.raises(BagError, match='nothing can be recovered'):
        repair(bad)
    assert (bad / 'cut_0.mcap').stat().st_size == 100_000
