# SPDX-License-Identifier: Apache-2.0
"""A bag that was cut or damaged: one clear error, or what is truly there, never anything else."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from calib_model.bags.measurement import read_measurement
from calib_model.bags.measurement_writer import pose_message, write_descriptions
from calib_model.bags.reader import read_messages
from calib_model.bags.record_reader import MAGIC
from calib_model.bags.writer import BagWriter
from calib_model.errors import BagError, CalibrationError
from calib_model.measurement import Measurement
from calib_model.topics import CAPTURE_POSES


@pytest.fixture(scope='module')
def bag(measured: Measurement, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A bag of the forty poses with a chunk after each, as a capture writes it."""
    path = tmp_path_factory.mktemp('bags') / 'bag'
    poses = measured.poses
    with BagWriter(path) as writer:
        write_descriptions(writer, measured.arm, measured.probe, measured.gauge, 1)
        writer.flush()
        for i in range(len(poses)):
            writer.write_message(CAPTURE_POSES, pose_message(measured, i), int(poses.stamp[i]))
            writer.flush()
    return (path / 'bag_0.mcap').read_bytes()


def assert_first_poses(found: Measurement, measured: Measurement) -> int:
    count = len(found.poses)
    for column in fields(measured.poses):
        ours = getattr(measured.poses, column.name)[:count]
        assert getattr(found.poses, column.name).tobytes() == ours.tobytes(), column.name
    assert (found.arm, found.gauge) == (measured.arm, measured.gauge)
    return count


def every(length: int, step: int) -> Iterator[int]:
    """Places all over, dense at the end where index and summary are."""
    yield from range(0, length, step)
    yield from range(length - 60, length)


@pytest.mark.slow
def test_a_bag_cut_anywhere_gives_its_complete_chunks(
    bag: bytes, measured: Measurement, tmp_path: Path
) -> None:
    file = tmp_path / 'cut.mcap'
    counts = []
    for end in every(len(bag), 101):
        file.write_bytes(bag[:end])
        try:
            counts.append(assert_first_poses(read_measurement(file), measured))
        except BagError as error:
            assert str(error).startswith(str(file))
            assert not counts, f'readable when cut shorter, not at {end}'
    assert counts == sorted(counts)
    assert set(counts) == set(range(1, 41))


@pytest.mark.slow
def test_no_complete_chunk_is_lost_by_a_cut(bag: bytes, tmp_path: Path) -> None:
    """Cut byte by byte through one chunk and its index: the poses before it all stay."""
    file = tmp_path / 'cut.mcap'

    def poses_before(end: int) -> int:
        file.write_bytes(bag[:end])
        return sum(message.topic == CAPTURE_POSES.name for message in read_messages(file))

    middle = len(bag) // 2
    found = [poses_before(end) for end in range(middle, middle + 500)]
    assert set(np.diff(found)) == {0, 1}


def test_a_cut_bag_can_be_refused(bag: bytes, tmp_path: Path) -> None:
    file = tmp_path / 'cut.mcap'
    file.write_bytes(bag[: len(bag) // 2])
    with pytest.raises(BagError, match='damaged'):
        list(read_messages(file, cut_allowed=False))
    file.write_bytes(bag)
    assert len(list(read_messages(file, cut_allowed=False))) == 43


@pytest.mark.slow
def test_a_flipped_bit_never_gives_wrong_or_fewer_poses(
    bag: bytes, measured: Measurement, tmp_path: Path
) -> None:
    file = tmp_path / 'flipped.mcap'
    rng = np.random.default_rng(11)
    refused = 0
    for place in every(len(bag), 47):
        damaged = bytearray(bag)
        damaged[place] ^= 1 << rng.integers(8)
        file.write_bytes(damaged)
        try:
            assert assert_first_poses(read_measurement(file), measured) == 40, f'byte {place}'
        except CalibrationError as error:
            assert '\n' not in str(error)
            refused += 1
    assert refused > 200


def test_garbage_in_the_middle_is_damage_not_a_cut(bag: bytes, tmp_path: Path) -> None:
    file = tmp_path / 'garbage.mcap'
    rng = np.random.default_rng(12)
    summary = int.from_bytes(bag[-28:-20], 'little')  # of the footer: where the messages end
    for start in range(1000, summary - 64, 700):
        file.write_bytes(bag[:start] + rng.bytes(64) + bag[start + 64 :])
        with pytest.raises(BagError, match='damaged'):
            read_measurement(file)


@pytest.mark.parametrize(
    'content',
    [b'', b'x', MAGIC, b'SQLite format 3\x00' * 100, bytes(10_000), 9 * MAGIC],
)
def test_what_is_no_bag_is_said_to_be_none(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / 'none.mcap'
    file.write_bytes(content)
    with pytest.raises(BagError, match=r'none\.mcap: '):
        read_measurement(file)
