# SPDX-License-Identifier: Apache-2.0
"""Raw recordings of any length, through every command that reads them whole, in flat memory.

The demo's here; with `SOAK=1` as many messages as an hour of a led arm makes, 1000 readings and 500
joint states in each second, and docs/soak.md says what they took.
"""

import os
import resource
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from memory import high_water
from soak import SOAK, note

from calib_model.bags import read_measurement

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / 'ros2_ws/src/calib_bringup/config'
WHICH = ('--locations', '1', '2', '3', '4', '--spheres', '1', '6', '10', '14')
LED = ('--raw', '--probe', 'active', *WHICH, '--speed', '0.09')
MOST = 1024 if SOAK else 300  # MiB that a process holds at most
AN_HOUR = 3600 * (1000 + 500)  # messages
LINEAR = 1.3  # s of the CPU per byte, against those of a quarter of the recording
PROGRESS = 100_000_000  # bytes from which on a command says how far it is
AS_LED = ('--mode', 'continuous', '--placements', str(CONFIG / 'locations/faro.yaml'))
COMMANDS = {
    'identify --raw': ('calib_solver.commands.identify', 'BAG', '--raw', '--output', 'OUT'),
    'pair': ('calib_capture.commands.pair', 'BAG', 'OUT', *(AS_LED if SOAK else ())),
    'recover': ('calib_capture.commands.recover', 'BAG', 'OUT'),
    'replay': ('calib_capture.nodes.replay_node', 'BAG', '--rate', '10000', '--wait', '0'),
}
pytestmark = [pytest.mark.system, pytest.mark.timeout(7200 if SOAK else 150)]


@dataclass(frozen=True)
class Done:
    """What a process said, s of the CPU that it took, and MiB that it held at most."""

    out: str
    error: str
    seconds: float
    held: float


def done(words, folder: Path) -> Done:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        [sys.executable, '-m', *words],
        cwd=folder,
        stdout=(folder / 'stdout').open('w'),
        stderr=(folder / 'stderr').open('w'),
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    held = 0.0
    while process.poll() is None:
        held = max(held, high_water(process.pid) / 2**20)
        time.sleep(0.02)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    out, error = ((folder / name).read_text() for name in ('stdout', 'stderr'))
    assert process.returncode == 0, error
    return Done(out, error, seconds, held)


@pytest.fixture(scope='module')
def recordings(tmp_path_factory) -> tuple[Path, ...]:
    """What is read; of a led arm the first quarter too, both without compression."""
    if not SOAK:
        return (ROOT / 'bags/demo/identification/identification_0.mcap',)
    folder = tmp_path_factory.mktemp('recorded')
    done(['selfcenter_probe.commands.hand_guided', 'led', *LED], folder)
    [packed] = (folder / 'led').glob('*.mcap')
    with packed.open('rb') as source:
        about = make_reader(source).get_summary().statistics
    assert about.message_count > AN_HOUR
    end = about.message_end_time
    cut(packed, folder / 'quarter.mcap', end - 3 * (end - about.message_start_time) // 4)
    cut(packed, folder / 'whole.mcap', end)
    return folder / 'quarter.mcap', folder / 'whole.mcap'


def cut(packed: Path, unpacked: Path, end: int) -> None:
    """The messages up to a log time."""
    with packed.open('rb') as source, unpacked.open('wb') as target:
        writer = Writer(target, compression=CompressionType.NONE)
        writer.start('ros2', 'rosbag2')
        channels: dict[int, int] = {}
        for schema, channel, message in make_reader(source).iter_messages(ending_at=end):
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()


@pytest.mark.parametrize('name', COMMANDS)
def test_a_recording_of_any_length_is_read_in_flat_memory(name, recordings, tmp_path):
    tried = []
    for bag in recordings:
        out = tmp_path / f'out_{bag.stem}'
        places = {'BAG': str(bag), 'OUT': str(out)}
        found = done([places.get(word, word) for word in COMMANDS[name]], tmp_path)
        size = bag.stat().st_size
        assert found.held < MOST, found
        assert size < PROGRESS or ' left' in found.error or ' of ' in found.error
        if name == 'recover':
            assert 'missing: nothing' in found.out
        if name in ('pair', 'recover'):
            assert len(read_measurement(out).poses) > 100
        tried.append((size, found.seconds))
    if SOAK:
        (size, seconds), (large, long) = tried
        assert long / large < LINEAR * seconds / size
        note(**{f'recording {name}': [large, long, found.held]})
