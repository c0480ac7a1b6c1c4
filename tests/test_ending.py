# SPDX-License-Identifier: Apache-2.0
"""Signals end commands and nodes at any moment of their lives, and nothing is left behind."""

from __future__ import annotations

import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest
from soak import SOAK, note

from calib_model.bags import read_measurement
from calib_model.kinematics import points
from calib_model.urdf import arm_urdf

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / 'bags' / 'demo'
PATIENCE = 60.0  # s, on a busy machine
STANDIN = str(ROOT / 'tools' / 'ros2' / 'ros2')
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
#: of each kind for each command, and s within which it has ended on an idle machine
SIGNALS, SOON, SEED = (100 if SOAK else 1), 5.0, 16
AT_ONCE = 2 if SOAK else 1  # of a command, each in a folder of its own
pytestmark = [pytest.mark.system, pytest.mark.timeout(180 * SIGNALS)]
SOONER, LATEST = 1.2, 4.0  # s after the start: most are done by the first, nearly all by the last
OUT = 'out'  # what a command may write, in the folder that it is started in
ALL_GIVEN = tuple(
    word
    for name in (
        'arm arms/kuka_kr5_sixx_r650',
        'probe probes/active_trihedron',
        'gauge gauges/ball_bar_kr5',
    )
    for word in (f'--{name.split()[0]}', CONFIG / f'{name.split()[1]}.yaml')
)
#: what a command is started with, and its exit code when its work is done
COMMANDS = {
    'identify': ('calib_solver', DEMO / 'identification', '--monte-carlo', 5000, '--output', OUT),
    'identify --raw': ('calib_solver', DEMO / 'identification', '--raw', '--output', OUT),
    'evaluate': ('calib_solver', DEMO / 'held_out'),
    'verify': ('calib_solver', DEMO / 'held_out', '--result', 'result', '--output', OUT),
    'compare': ('calib_solver', 'result', 'result', '--output', OUT),
    'compensate': ('calib_solver', 'result', 'joints.csv', OUT, '--tool', 'flange'),
    'report': ('calib_solver', 'copy'),
    'kuka_figures': ('calib_solver', 'result', '--assume-urdf'),
    'recover': ('calib_capture', DEMO / 'identification', OUT),
    'pair': ('calib_capture', DEMO / 'held_out', OUT),
    'import_csv': ('calib_capture', 'poses.csv', OUT, *ALL_GIVEN),
    'import_points': ('calib_capture', 'points.csv', OUT, *ALL_GIVEN[:2]),
    'place': ('calib_capture', *ALL_GIVEN, OUT, '--count', 2),
    'plan': ('calib_capture', '--locations', 1, '--spheres', 1, '--poses', 4),
    'replay': ('calib_capture', DEMO / 'held_out', '--rate', 200, '--wait', 0),
    'arm_from_urdf': ('calib_model', 'arm.urdf', OUT),
    'hand_guided': ('selfcenter_probe', OUT, '--locations', 1, '--spheres', 1, '--poses', 9),
    'check': ('calib_capture',),
    'capture': ('calib_capture', '--ros-args', '-p', f'output:={OUT}'),
    'demo': ('calib_bringup', '--poses', 2, '--output', OUT),
}
#: nodes end with 0 when they are told to
NODES = {
    'capture_points': ('calib_capture',),
    'solver': ('calib_solver',),
    'arm': ('calib_capture',),
    'probe': ('selfcenter_probe',),
    'operator': ('selfcenter_probe',),
}
STARTED = {
    name: (STANDIN, 'run', given[0], *name.split(), *map(str, given[1:]))
    for name, given in {**COMMANDS, **NODES}.items()
}


@dataclass(frozen=True)
class Ended:
    """How a process ended that was told to after so many seconds."""

    code: int
    said: str
    after: float


def ended(words: Sequence[str], folder: Path, number: int, after: float) -> Ended:
    process = subprocess.Popen(
        words,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={
            **os.environ,
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF',
            'TMPDIR': str(folder / 'temporary'),
        },
    )
    try:
        wait_until_it_hears(process, number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(after)
        process.send_signal(number)
        told = time.monotonic()
        said = process.communicate(timeout=PATIENCE)[0].decode(errors='replace')
        if SOAK:  # on an idle machine
            assert time.monotonic() - told < SOON, (words, after, said)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return Ended(process.returncode, said, after)


def wait_until_it_hears(process: subprocess.Popen[bytes], number: int) -> None:
    """Until a signal is held back or minded: before, on a busy machine, nothing of it runs yet."""
    bit = 1 << (number - 1)
    while process.poll() is None:
        status = Path(f'/proc/{process.pid}/status').read_text()
        if any(int(mask, 16) & bit for mask in re.findall(r'Sig(?:Blk|Cgt):\s+(\w+)', status)):
            return


@pytest.fixture(scope='module')
def given(tmp_path_factory) -> Path:
    """A folder with what the commands are given."""
    folder = tmp_path_factory.mktemp('given')
    measured = read_measurement(DEMO / 'identification')
    run = [STANDIN, 'run', 'calib_solver', 'identify', DEMO / 'held_out', '--output', 'result']
    subprocess.run(list(map(str, run)), cwd=folder, check=True, capture_output=True)
    shutil.copytree(folder / 'result', folder / 'copy')
    (folder / 'temporary').mkdir()
    (folder / 'arm.urdf').write_text(arm_urdf(measured.arm))
    poses = measured.poses
    joints = [f'q{n}' for n in range(1, 7)]
    seen = points(measured.arm, poses.joints, np.zeros((len(poses), 3)))
    for name, header, columns in (
        ('joints', joints, poses.joints[:50]),
        ('points', [*joints, 'x', 'y', 'z'], np.hstack([poses.joints, seen])),
    ):
        write_table(folder / f'{name}.csv', header, columns)
    header = ['location', 'sphere', *joints, 's1', 's2', 's3']
    numbers = np.stack([poses.location, poses.sphere], axis=1)
    write_table(
        folder / 'poses.csv', header, np.hstack([numbers, poses.joints, poses.displacement])
    )
    return folder


def write_table(path: Path, header: Sequence[str], columns) -> None:
    lines = [','.join(format(each, '.12g') for each in row) for row in columns]
    path.write_text('\n'.join([','.join(header), *lines]) + '\n')


def there(folder: Path) -> dict[str, bytes]:
    """The files of a folder, but for what a command may write when it is done."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b''
        for path in sorted(folder.rglob('*'))
        if path.relative_to(folder).parts[0] not in (OUT, 'copy')
    }


@pytest.mark.parametrize('name', STARTED)
def test_a_signal_ends_it_at_any_moment_with_the_documented_code(name, given, tmp_path):
    """From the first millisecond on, for as long as it loads, and at work."""
    folders = [tmp_path / str(number) for number in range(AT_ONCE)]
    for folder in folders:
        shutil.copytree(given, folder)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        codes = Counter(sum(pool.map(partial(signalled, name), folders), []))
    note(**{f'ended {name}': {str(code): count for code, count in codes.items()}})


def signalled(name: str, folder: Path) -> list[int]:
    """What it ended with, in a folder of its own."""
    rng = random.Random(f'{name} {folder.name} {SEED}')
    codes = (0,) if name in NODES else (0, 130)
    before, seen = there(folder), []
    for number in (signal.SIGINT, signal.SIGTERM) * (SIGNALS // AT_ONCE):
        after = rng.uniform(0.0, rng.choice((SOONER, SOONER, LATEST)))
        found = ended(STARTED[name], folder, number, after)
        how = f'{signal.Signals(number).name} after {after:.3f} s: {found}'
        assert found.code in codes, how
        assert 'Traceback' not in found.said, how
        assert there(folder) == before, how
        left = folder / OUT  # there is nothing, or, when its work was done, all of it
        assert not list(left.rglob('*.part')), how
        shutil.rmtree(left) if left.is_dir() else left.unlink(missing_ok=True)
        seen.append(found.code)
    return seen


@pytest.mark.parametrize('name', ['solver', 'identify'])
def test_ctrl_c_ends_also_what_a_script_has_put_into_the_background(name, tmp_path):
    """Its shell has SIGINT ignored there, and the script says `kill -INT $!`."""
    code = 0 if name in NODES else 130
    start = ' '.join(STARTED[name])
    script = f'{start} & sleep 1.7; kill -INT $!; wait $!'
    ran = subprocess.run(['bash', '-c', script], cwd=tmp_path, timeout=PATIENCE, check=False)
    assert ran.returncode == code


def test_a_signal_when_the_work_is_done_changes_no_exit_code(tmp_path):
    """Python gives the signals back before it has taken its modules down."""
    for after in (0.01, 0.03):  # s after the last line
        out = tmp_path / f'after_{after}'
        words = [*STARTED['recover'][:-1], str(out)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
            assert process.stdout is not None
            assert any(b'missing: nothing' in line for line in process.stdout)
            time.sleep(after)
            process.send_signal(signal.SIGTERM)
            process.wait(PATIENCE)
        # what is told while the line is printed interrupts
        assert process.returncode in (0, 130), after


def test_every_command_and_node_minds_signals_before_it_loads_anything():
    """Each is loaded through the folder whose file begins with that."""
    for entry in metadata.entry_points(group='console_scripts'):
        package = entry.value.partition('.')[0]
        if not package.startswith(('calib_', 'selfcenter_')) or entry.name == 'calib':
            continue
        module = entry.value.partition(':')[0]
        code = (
            'import signal, sys\n'
            f"sys.orig_argv = ['python', '-m', '{module}']\n"
            f'import {module.rpartition(".")[0]}\n'
            "print(callable(signal.getsignal(signal.SIGTERM)), 'numpy' in sys.modules)"
        )
        said = subprocess.run(
            [sys.executable, '-c', code], capture_output=True, text=True, check=True
        )
        assert said.stdout == 'True False\n', module


def test_who_merely_imports_a_command_keeps_its_signals():
    code = (
        'import signal\nfrom calib_solver.commands import kuka_figures\n'
        'print(signal.getsignal(signal.SIGTERM) is signal.SIG_DFL)'
    )
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert said.stdout == 'True\n'
