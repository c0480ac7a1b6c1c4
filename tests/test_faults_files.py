# SPDX-License-Identifier: Apache-2.0
"""Full disks, cut bags and odd paths, as a user meets them: real commands, one line, no loss."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import zstandard

ROOT = Path(__file__).resolve().parents[1]

import damaged_bags

from calib_model.bags import (
    BagWriter,
    read_measurement,
    read_messages,
    repair,
    write_measurement,
)
from calib_model.measurement import Measurement
from calib_model.topics import CAPTURE_POSES

DEMO = ROOT / 'bags' / 'demo' / 'held_out'
RESULTS = (
    'arm.yaml',
    'probe.yaml',
    'arm.urdf',
    'report.html',
    'report.json',
    'uncertainty.json',
    'result.json',
)
TIMEOUT = 60
MOST_MEMORY = 2 << 20  # KiB
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


@dataclass(frozen=True)
class Done:
    """How a command ended; `memory` is the most it had, KiB."""

    returncode: int
    stdout: str
    stderr: str
    memory: int

    def one_line(self, *said: str) -> None:
        """It refused: exit code 2, nothing on stdout and one line on stderr that has all these."""
        assert self.returncode == 2, self
        assert self.stdout == ''
        assert len(self.stderr.splitlines()) == 1, self.stderr
        assert 'Traceback' not in self.stderr
        for part in said:
            assert part in self.stderr
        assert self.memory < MOST_MEMORY


@pytest.fixture(scope='module')
def environment() -> dict[str, str]:
    """What a shell that has sourced env.bash passes on."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    return dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)


@pytest.fixture
def ros2(environment: dict[str, str], tmp_path: Path) -> Callable[..., Done]:
    """`ros2 run PACKAGE COMMAND ...`, its memory watched."""

    def run(*words: object) -> Done:
        outputs = [(tmp_path / name).open('w+') for name in ('.stdout', '.stderr')]
        process = subprocess.Popen(
            [shutil.which('ros2', path=environment['PATH']), 'run', *map(str, words)],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=outputs[0],
            stderr=outputs[1],
        )
        end = time.monotonic() + TIMEOUT
        while (found := os.wait4(process.pid, os.WNOHANG))[0] == 0:
            if time.monotonic() > end:
                process.kill()
                os.wait4(process.pid, 0)
                raise AssertionError(f'{words}: hangs')
            time.sleep(0.01)
        process.returncode = os.waitstatus_to_exitcode(found[1])
        texts = []
        for stream in outputs:
            stream.seek(0)
            texts.append(stream.read())
            stream.close()
        return Done(process.returncode, *texts, found[2].ru_maxrss)

    return run


@pytest.fixture(scope='module')
def measured() -> Measurement:
    whole = read_measurement(DEMO)
    return replace(whole, poses=whole.poses.take(np.arange(0, len(whole.poses), 2)))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Callable[[int], Path]]:
    """Makes disks of so many KiB; skips where nothing may be mounted."""
    disks: list[Path] = []

    def make(size: int) -> Path:
        disk = tmp_path / f'disk{len(disks)}'
        disk.mkdir()
        done = subprocess.run(
            ['mount', '-t', 'tmpfs', '-o', f'size={size}k', 'tmpfs', disk],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            pytest.skip(f'no disk can be mounted here: {done.stderr.strip()}')
        disks.append(disk)
        return disk

    if shutil.which('mount') is None or os.geteuid() != 0:
        pytest.skip('only root can mount a small disk')
    yield make
    for disk in disks:
        subprocess.run(['umount', '-l', disk], check=True)


def fill(disk: Path, leave: int) -> None:
    """Take all of a disk but so many bytes."""
    free = shutil.disk_usage(disk).free
    with (disk / 'filler').open('wb') as stream:
        stream.write(bytes(max(0, free - leave)))


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob('*'))
        if path.is_file() and path.name != 'filler'
    }


# Full disks


@pytest.mark.parametrize('leave', [0, 40_000])
def test_a_full_disk_leaves_the_results_that_were_there(
    leave: int, ros2: Callable[..., Done], small_disk: Callable[[int], Path]
) -> None:
    disk = small_disk(1024)
    results = disk / 'results'
    results.mkdir()
    for name in (*RESULTS, 'correction.yaml'):
        (results / name).write_text(f'{name} of an earlier run\n')
    before = contents(disk)
    fill(disk, leave)
    done = ros2('calib_solver', 'identify', DEMO, '--output', results)
    done.one_line(f'{results}: results cannot be written: No space left on device')
    assert contents(disk) == before


FULL = {
    'identify to a new folder': (
        ('calib_solver', 'identify', DEMO, '--output', '{disk}/new/results'),
    ),
    'recover': (('calib_capture', 'recover', DEMO, '{disk}/new_bag'),),
    'import_csv': (
        (
            'calib_capture',
            'import_csv',
            '{table}',
            '{disk}/new_bag',
            '--arm',
            '{arm}',
            '--probe',
            '{probe}',
            '--gauge',
            '{gauge}',
        ),
    ),
}


@pytest.mark.parametrize('command', FULL)
def test_a_full_disk_is_one_line_and_nothing_is_begun(
    command: str, ros2: Callable[..., Done], small_disk: Callable[[int], Path], tmp_path: Path
) -> None:
    disk = small_disk(1024)
    fill(disk, 4096)
    config = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
    names = {
        'disk': disk,
        'table': tmp_path / 'table.csv',
        'arm': config / 'arms' / 'kuka_kr5_sixx_r650.yaml',
        'probe': config / 'probes' / 'active_trihedron.yaml',
        'gauge': config / 'gauges' / 'ball_bar_kr5.yaml',
    }
    rows = [f'1,{1 + i % 15},{",".join(["0.1"] * 6)},0,0,0' for i in range(2000)]
    header = 'location,sphere,q1,q2,q3,q4,q5,q6,s1,s2,s3'
    names['table'].write_text('\n'.join([header, *rows]))
    done = ros2(*(str(word).format(**names) for word in FULL[command][0]))
    done.one_line('No space left on device', str(disk))
    assert contents(disk) == {}


def test_a_disk_that_fills_during_a_capture_costs_no_pose_that_was_told_of(
    environment: dict[str, str], small_disk: Callable[[int], Path], tmp_path: Path
) -> None:
    pytest.importorskip('rclpy')
    from calib_bringup.domains import held_domain
    from calib_bringup.processes import Child, Children, graph_environment

    disk = small_disk(2048)
    (disk / 'earlier').mkdir()
    (disk / 'earlier' / 'mine').write_text('of an earlier run')
    fill(disk, 300_000)
    env = {**environment, **graph_environment(held_domain())}
    with Children() as children:

        def start(name: str, module: str, **parameters: object) -> Child:
            given = [part for k, v in parameters.items() for part in ('-p', f'{k}:={v}')]
            log = tmp_path / f'{name}.log'
            return children.start(Child(name, module, ['--ros-args', *given], env, log))

        start('arm', 'calib_capture.nodes.arm_node', time_scale=0.0)
        start('probe', 'selfcenter_probe.nodes.probe_node', seed=3)
        capture = start(
            'capture',
            'calib_capture.nodes.capture_node',
            output=disk / 'bag',
            locations='[1, 2, 3]',
            between_locations='simulated',
            spheres='[1, 6, 10, 14]',
            poses_per_sphere=60,
            pool=1,
        )
        assert capture.process.wait(60) == 2
    said = (tmp_path / 'capture.log').read_text().strip().splitlines()
    assert 'Traceback' not in '\n'.join(said)
    assert said[-1] == f'{disk}/bag: cannot be written: No space left on device'
    assert (disk / 'earlier' / 'mine').read_text() == 'of an earlier run'
    opened = read_measurement(disk / 'bag')
    assert len(opened.poses) > 20
    shutil.copytree(disk / 'bag', tmp_path / 'bag')
    repair(tmp_path / 'bag')
    assert len(read_measurement(tmp_path / 'bag').poses) == len(opened.poses)
    list(read_messages(tmp_path / 'bag', cut_allowed=False))


def test_a_write_that_fails_leaves_a_bag_that_ends_at_its_last_flush(
    measured: Measurement, small_disk: Callable[[int], Path]
) -> None:
    """And nothing is written behind the piece of a chunk that still found room."""
    disk = small_disk(256)
    with pytest.raises(Exception, match='No space left on device') as caught:
        damaged_bags.bytes_of(replace(measured, poses=many(measured)), disk / 'bag')
    assert type(caught.value).__name__ == 'BagError'
    there = [m for m in read_messages(disk / 'bag') if m.topic == CAPTURE_POSES.name]
    assert len(there) > 100
    (disk / 'bag' / 'bag_0.mcap').rename(disk / 'bag' / 'copy.mcap')
    size = (disk / 'bag' / 'copy.mcap').stat().st_size
    assert size < 256 * 1024 - 4096  # the piece was given back


def many(measured: Measurement):
    return measured.poses.joined([measured.poses] * 20)


# Paths


def test_a_folder_that_cannot_be_written_is_named(
    ros2: Callable[..., Done], small_disk: Callable[[int], Path]
) -> None:
    disk = small_disk(1024)
    subprocess.run(['mount', '-o', 'remount,ro', disk], check=True)
    ros2('calib_solver', 'identify', DEMO, '--output', disk / 'results').one_line(
        'results: results cannot be written: Read-only file system'
    )
    ros2('calib_capture', 'recover', DEMO, disk / 'bag').one_line('Read-only file system')


PATHS = {
    'an output that is a file': (
        'identify',
        '{taken}',
        'results cannot be written: Not a directory',
    ),
    'a parent that is a file': (
        'identify',
        '{taken}/a',
        'results cannot be written: Not a directory',
    ),
    'a link into itself': ('identify', '{loop}', 'results cannot be written: '),
    'a name no file can have': ('identify', '{taken}' + 'a' * 300, 'File name too long'),
    'a bag on top of a file': ('recover', '{taken}', 'exists already'),
    'a bag on top of a broken link': ('recover', '{broken}', 'exists already'),
    'a bag below a file': (
        'recover',
        '{taken}/bag',
        'taken/bag: cannot be written: Not a directory',
    ),
}


@pytest.mark.parametrize('fault', PATHS)
def test_an_output_that_cannot_be_is_one_line(
    fault: str, ros2: Callable[..., Done], tmp_path: Path
) -> None:
    taken, loop, broken = (tmp_path / name for name in ('taken', 'loop', 'broken'))
    taken.write_text('mine')
    loop.symlink_to(loop)
    broken.symlink_to(tmp_path / 'nothing')
    command, output, said = PATHS[fault]
    output = output.format(taken=taken, loop=loop, broken=broken)
    if command == 'identify':
        done = ros2('calib_solver', 'identify', DEMO, '--output', output)
    else:
        done = ros2('calib_capture', 'recover', DEMO, output)
    done.one_line(said)
    assert taken.read_text() == 'mine'
    assert broken.is_symlink() and loop.is_symlink()


def test_no_file_takes_the_place_of_a_device_or_a_pipe(
    ros2: Callable[..., Done], tmp_path: Path
) -> None:
    """A new file replaces an old one, and root may replace anything."""
    pipe = tmp_path / 'pipe'
    os.mkfifo(pipe)
    results, urdf = tmp_path / 'results', tmp_path / 'results' / 'arm.urdf'
    ros2('calib_solver', 'identify', DEMO, '--output', results)
    ros2('calib_model', 'arm_from_urdf', urdf, pipe).one_line('not a regular file')
    (results / 'robot.urdf').symlink_to(pipe)
    done = ros2('calib_solver', 'identify', DEMO, '--output', results, '--urdf', urdf)
    done.one_line('not a regular file')
    device = os.stat('/dev/null')
    for name in ('/dev/null', '/dev/stdout'):
        ros2('calib_model', 'arm_from_urdf', urdf, name).one_line('not a regular file')
    assert pipe.is_fifo() and os.stat('/dev/null').st_rdev == device.st_rdev != 0


def test_a_missing_parent_is_made(ros2: Callable[..., Done], tmp_path: Path) -> None:
    done = ros2('calib_solver', 'identify', DEMO, '--output', tmp_path / 'a' / 'b')
    assert done.returncode == 0
    assert {path.name for path in (tmp_path / 'a' / 'b').iterdir()} == set(RESULTS)
    assert not list((tmp_path / 'a').glob('.*'))


@pytest.mark.parametrize('device', ['/dev/zero', '/dev/full', '/dev/null', 'pipe'])
@pytest.mark.parametrize('option', ['bag', '--arm', '--prior', '--links'])
def test_a_device_or_a_pipe_is_no_input(
    device: str, option: str, ros2: Callable[..., Done], tmp_path: Path
) -> None:
    if device == 'pipe':
        device = str(tmp_path / 'pipe')
        os.mkfifo(device)
    words = (device,) if option == 'bag' else (DEMO, option, device)
    ros2('calib_solver', 'identify', *words).one_line(device)


# Cut bags


CUTS = (0.0, 0.001, 0.2, 0.45, 0.7, 0.9, 0.97, 0.9999, 1.0)


@pytest.mark.parametrize('share', CUTS)
def test_recover_tells_what_came_back_of_a_cut_bag_and_what_did_not(
    share: float, measured: Measurement, ros2: Callable[..., Done], tmp_path: Path
) -> None:
    whole = damaged_bags.bytes_of(measured, tmp_path / 'whole')
    expected = list(read_messages(tmp_path / 'whole'))
    bad = tmp_path / 'bad'
    bad.mkdir()
    (bad / 'bad_0.mcap').write_bytes(whole[: int(share * len(whole))])
    done = ros2('calib_capture', 'recover', bad, tmp_path / 'out')
    if share < 0.01:
        done.one_line('no complete chunk in it, nothing can be recovered')
        assert not (tmp_path / 'out').exists()
        return
    there = list(read_messages(tmp_path / 'out', cut_allowed=False))
    assert there == expected[: len(there)]
    assert there == list(read_messages(bad))
    lossy = len(there) < len(expected)
    assert done.returncode == (3 if lossy else 0)
    said = done.stdout.splitlines()
    missing = 'no end of the recording' if lossy else 'nothing'
    assert f'{len(there)} messages recovered, missing: {missing}' in said[-1]
    assert f'{len(there) - 3:>9} {CAPTURE_POSES.name}' in said


@pytest.mark.parametrize('packed', ['plain', 'file', 'message'])
def test_a_split_bag_of_which_a_file_was_cut_comes_back_but_for_its_end(
    packed: str, measured: Measurement, ros2: Callable[..., Done], tmp_path: Path
) -> None:
    """As rosbag2 leaves it when killed: finished files packed, the last as it was, no list."""
    damaged_bags.bytes_of(measured, tmp_path / 'whole')
    expected = list(read_messages(tmp_path / 'whole'))
    bad = tmp_path / 'bad'
    bad.mkdir()
    for number, part in enumerate(np.array_split(np.arange(len(expected)), 3)):
        part_bag = tmp_path / f'part{number}'
        with BagWriter(part_bag) as bag:
            for row in part:
                message = expected[row]
                data = zstandard.compress(message.data) if packed == 'message' else message.data
                topic = next(t for t in damaged_bags.TOPICS if t.name == message.topic)
                bag.write(topic, data, message.log_time, message.publish_time)
                bag.flush()
        content = (part_bag / f'part{number}_0.mcap').read_bytes()
        if number == 2:
            (bad / 'bad_2.mcap').write_bytes(content[: len(content) // 2])
        elif packed == 'file':
            (bad / f'bad_{number}.mcap.zstd').write_bytes(zstandard.compress(content))
        else:
            (bad / f'bad_{number}.mcap').write_bytes(content)
    done = ros2('calib_capture', 'recover', bad, tmp_path / 'out')
    assert done.returncode == 3, done.stderr
    there = list(read_messages(tmp_path / 'out', cut_allowed=False))
    assert [message.data for message in there] == [m.data for m in expected[: len(there)]]
    assert len(there) > 2 * len(expected) // 3
    read = list(read_messages(bad))
    assert [message.data for message in read] == [message.data for message in there]


# Bad input to the real commands: exit code, one line, memory


def bad_inputs(folder: Path) -> dict[str, tuple[object, ...]]:
    """Commands by fault."""
    measured = replace(read_measurement(DEMO), source='demo')
    (folder / 'laughs.yaml').write_text(
        'a: &a [x, x]\n' + ''.join(f'b{i}: &b{i} [{"*a, " * 9}]\n' for i in range(9))
    )
    (folder / 'latin.yaml').write_bytes('name: Gr\xfc\xdfe\n'.encode('latin-1'))
    (folder / 'tabs.yaml').write_text('name:\tx\njoints:\n\t- {}\n')
    (folder / 'twice.yaml').write_text('name: a\nname: b\njoints: []\n')
    (folder / 'huge.yaml').write_text('name: ' + 'x' * 30_000_000)
    (folder / 'laughs.urdf').write_text(
        '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
        + ''.join(f'<!ENTITY {chr(98 + i)} "{f"&{chr(97 + i)};" * 10}">' for i in range(9))
        + ']><robot name="&j;"/>'
    )
    (folder / 'huge.csv').write_text('location,sphere\n' + '"' + 'x' * 30_000_000)
    q = np.array(measured.poses.joints)
    q[7, 3] = np.nan
    poses = replace(measured.poses, joints=q)
    write_measurement(folder / 'nan_bag', replace(measured, poses=poses))
    bombs = damaged_bags.BOMBS
    config = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
    described = (
        '--arm',
        config / 'arms' / 'kuka_kr5_sixx_r650.yaml',
        '--probe',
        config / 'probes' / 'active_trihedron.yaml',
        '--gauge',
        config / 'gauges' / 'ball_bar_kr5.yaml',
    )
    return {
        'aliases are not supported': (
            'calib_solver',
            'identify',
            DEMO,
            '--arm',
            folder / 'laughs.yaml',
        ),
        'not a text file': ('calib_solver', 'evaluate', DEMO, '--arm', folder / 'latin.yaml'),
        'not valid YAML': ('calib_solver', 'evaluate', DEMO, '--gauge', folder / 'tabs.yaml'),
        'is there twice': ('calib_solver', 'evaluate', DEMO, '--arm', folder / 'twice.yaml'),
        'larger than': ('calib_solver', 'evaluate', DEMO, '--probe', folder / 'huge.yaml'),
        'has a DOCTYPE': ('calib_model', 'arm_from_urdf', folder / 'laughs.urdf', folder / 'out'),
        'no column': (
            'calib_capture',
            'import_csv',
            folder / 'huge.csv',
            folder / 'out',
            *described,
        ),
        'has a joint that is not finite': ('calib_solver', 'identify', folder / 'nan_bag'),
        'more than is taken': (
            'calib_solver',
            'identify',
            bombs['poses of a million joints'](measured, folder),
        ),
        '4294967296 bytes': (
            'calib_solver',
            'identify',
            bombs['a zstd chunk of four gigabytes'](measured, folder),
        ),
    }


def test_bad_input_of_any_kind_is_one_line_and_little_memory(
    ros2: Callable[..., Done], tmp_path: Path
) -> None:
    for said, words in bad_inputs(tmp_path).items():
        ros2(*words).one_line(said)


def test_good_input_still_goes_through(ros2: Callable[..., Done]) -> None:
    done = ros2('calib_solver', 'evaluate', DEMO)
    assert done.returncode == 0
    assert json.loads(done.stdout)['distance']['count'] > 0
    assert done.memory < MOST_MEMORY
