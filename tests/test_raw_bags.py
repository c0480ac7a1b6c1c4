# SPDX-License-Identifier: Apache-2.0
"""Bags of people who have the robot: two raw topics, recorded by others, identified as ours are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode

from calib_model.bags import BagMessage, cdr, read_measurement, read_messages
from calib_model.descriptions import arm_yaml, gauge_yaml, probe_yaml
from calib_model.errors import BagError
from calib_model.topics import DISPLACEMENTS, JOINT_STATE, JOINT_STATES, PROBE_DISPLACEMENTS
from calib_solver.calibration import Calibration, Sources, calibrate
from calib_solver.commands.identify import run
from calib_solver.fitting import Options

OURS = Path(__file__).resolve().parent.parent / 'bags' / 'demo' / 'identification'
#: two more than the arm has, and not in its order
NAMES = ['joint_a4', 'gripper', 'joint_a1', 'joint_a6', 'joint_a2', 'rail', 'joint_a5', 'joint_a3']
TOPICS = (JOINT_STATES.name, PROBE_DISPLACEMENTS.name)


@pytest.fixture(scope='module')
def stream() -> list[BagMessage]:
    """The raw messages of our own capture, in the order they came."""
    return list(read_messages(OURS, set(TOPICS)))


@pytest.fixture(scope='module')
def ours() -> Calibration:
    return calibrate(Sources((str(OURS),)), Options())


@pytest.fixture(scope='module')
def described(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Arguments that give the three descriptions."""
    folder, measured = tmp_path_factory.mktemp('described'), read_measurement(OURS)
    texts = {
        'arm': arm_yaml(measured.arm),
        'probe': probe_yaml(measured.probe),
        'gauge': gauge_yaml(measured.gauge),
    }
    for name, text in texts.items():
        (folder / f'{name}.yaml').write_text(text)
    return [word for name in texts for word in (f'--{name}', str(folder / f'{name}.yaml'))]


def rewritten(
    path: Path,
    stream: Sequence[BagMessage],
    topics: Sequence[str] = TOPICS,
    mode: CompressionMode = CompressionMode.STORAGE,
    plugin: StoragePlugin = StoragePlugin.MCAP,
    names: Sequence[str] = NAMES,
) -> Path:
    """The streams as rosbags' writer puts them on disk; `names` shuffle and add joints."""
    store = cdr.typestore()
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        kinds = {TOPICS[0]: JOINT_STATE, TOPICS[1]: DISPLACEMENTS}
        channel = {
            topic: writer.add_connection(name, kinds[topic], typestore=store)
            for topic, name in zip(TOPICS, topics, strict=True)
        }
        for message in stream:
            data = message.data
            if message.topic == TOPICS[0]:
                state = cdr.decode(JOINT_STATE, data)
                known = dict(zip(state.name, state.position, strict=True))
                values = np.array([known.get(name.removeprefix('axis_'), 0.123) for name in names])
                stamp = cdr.stamp_of(state)
                data = cdr.encode(cdr.joint_state(stamp, 'base_link', list(names), values))
            writer.write(channel[message.topic], message.log_time, data)
    return path


def parameters(calibration: Calibration) -> list[float | None]:
    return [one['identified'] for one in calibration.record['parameters']]


def as_captured(expected: Any) -> Any:
    """What equals a result from our bag's own poses; what is no float as it is.

    That capture interpolated between two joint states; those of a stop are averaged now, which
    rounds in another way.
    """
    if isinstance(expected, float):
        return pytest.approx(expected, rel=1e-10, abs=1e-14)
    if isinstance(expected, list):
        return [as_captured(each) for each in expected]
    if isinstance(expected, dict):
        return {name: as_captured(value) for name, value in expected.items()}
    return expected


@pytest.mark.slow
def test_the_raw_streams_are_identified_as_our_own_capture(
    stream: list[BagMessage], ours: Calibration, described: list[str], tmp_path: Path
) -> None:
    """Two topics, shuffled names, eight joints of which six are the arm's, zstd chunks."""
    theirs = run([str(rewritten(tmp_path / 'bag', stream)), *described])
    for part in ('parameters', 'quality', 'spheres'):
        assert theirs.record[part] == as_captured(ours.record[part])
    said = '\n'.join(theirs.notes)
    assert f'{len(read_measurement(OURS).poses)} poses of an arm that stops for each' in said
    assert '7 locations of the gauge with 28 spheres told apart' in said
    assert 'spheres 1 6 10 14, by the identified distances' in said


OTHERS = [
    (CompressionMode.FILE, StoragePlugin.MCAP),
    (CompressionMode.MESSAGE, StoragePlugin.SQLITE3),
]


@pytest.mark.slow
@pytest.mark.parametrize(('mode', 'plugin'), OTHERS)
def test_other_topics_storage_and_names_come_to_the_same(
    stream: list[BagMessage],
    ours: Calibration,
    described: list[str],
    tmp_path: Path,
    mode: CompressionMode,
    plugin: StoragePlugin,
) -> None:
    topics = ('/cell_4/joints', '/cell_4/styli')
    renamed = [f'axis_{name}' for name in NAMES]
    path = rewritten(tmp_path / 'bag', stream, topics, mode, plugin, renamed)
    axes = [f'axis_joint_a{i}' for i in range(1, 7)]
    words = [str(path), '--joint-states', topics[0], '--displacements', topics[1]]
    with pytest.raises(BagError, match=f'on {topics[1]}: say which with --displacements'):
        run([str(path), '--joint-states', topics[0], *described])
    theirs = run([*words, '--joints', *axes, '--spheres', '1', '6', '10', '14', *described])
    assert parameters(theirs) == as_captured(parameters(ours))


@pytest.mark.slow
def test_bags_of_three_days_are_one_calibration(
    stream: list[BagMessage], ours: Calibration, described: list[str], tmp_path: Path
) -> None:
    """One bag for locations 1 to 3, 4 to 6 and 7, the locations numbered on."""
    poses = read_measurement(OURS).poses
    ends = [int(poses.stamp[poses.location == number].max()) for number in (3, 6, 7)]
    bags, begin = [], 0
    for number, end in enumerate(ends):
        part = [each for each in stream if begin <= stamp_of(each) < end + 200_000_000]
        bags.append(str(rewritten(tmp_path / f'day_{number}', part)))
        begin = end + 200_000_000
    theirs = run([*bags, *described])
    assert theirs.record['spheres'] == as_captured(ours.record['spheres'])
    assert parameters(theirs) == as_captured(parameters(ours))


def stamp_of(message: BagMessage) -> int:
    kind = JOINT_STATE if message.topic == TOPICS[0] else DISPLACEMENTS
    return cdr.stamp_of(cdr.decode(kind, message.data))


@pytest.mark.slow
def test_a_raw_bag_can_be_held_out(
    stream: list[BagMessage], described: list[str], tmp_path: Path
) -> None:
    held_out = OURS.parent / 'held_out'
    expected = calibrate(Sources((str(OURS),)), Options(), [str(held_out)])
    raw = rewritten(tmp_path / 'raw', list(read_messages(held_out, set(TOPICS))))
    found = run([str(OURS), '--test', str(raw), *described])
    expected_test, test = expected.record['quality']['test'], found.record['quality']['test']
    for figure in ('mean', 'max'):
        assert test['distance'][figure] == pytest.approx(expected_test['distance'][figure])
        assert test['two_sigma'][figure] == pytest.approx(expected_test['two_sigma'][figure])


def test_what_is_missing_is_asked_for(
    stream: list[BagMessage], described: list[str], tmp_path: Path
) -> None:
    path = rewritten(tmp_path / 'bag', stream)
    every = '/arm_description, /probe_description, /gauge_description: give --arm arm.yaml --probe'
    with pytest.raises(BagError, match=every):
        run([str(path)])
    with pytest.raises(BagError, match=r'no /gauge_description: give --gauge gauge\.yaml'):
        run([str(path), *described[:4]])
    (path / 'metadata.yaml').unlink()
    with pytest.raises(BagError, match=every):
        run([str(path)])
    theirs = [name.replace('joint_', 'axis_') for name in NAMES]
    other = rewritten(tmp_path / 'other', stream, names=theirs)
    lacking = r'has no joint joint_a1 \(it has axis_a4, gripper, .*\): say which .* with --joints'
    with pytest.raises(BagError, match=lacking):
        run([str(other), *described])
    silent = rewritten(tmp_path / 'silent', [m for m in stream if m.topic == TOPICS[0]])
    with pytest.raises(BagError, match='no messages on /probe/displacements, nor any other'):
        run([str(silent), *described])


def test_poses_are_left_alone_unless_raw_is_said(ours: Calibration, tmp_path: Path) -> None:
    assert ours.notes == ()
    anew = calibrate(replace(Sources((str(OURS),)), anew=True), Options())
    assert anew.notes
    assert parameters(anew) == as_captured(parameters(ours))
