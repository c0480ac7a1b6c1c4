# SPDX-License-Identifier: Apache-2.0
"""Signals end commands and nodes at any moment of their lives, and nothing is left behind."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

import pytest

pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]

ROOT = Path(__file__).resolve().parents[1]
DEMO = ROOT / 'bags' / 'demo'
PATIENCE = 60.0  # s, on a busy machine
STANDIN = ROOT / 'tools' / 'ros2' / 'ros2'
#: what is started, and its exit code when it is ended
STARTED = {
    'identify': (
        ('calib_solver', 'identify', DEMO / 'identification', '--monte-carlo', '5000'),
        130,
    ),
    'recover': (('calib_capture', 'recover', DEMO / 'identification', 'out'), 130),
    'solver': (('calib_solver', 'solver'), 0),
    'arm': (('calib_capture', 'arm'), 0),
}


def ended(words: list[str], folder: Path, number: int, after: float) -> tuple[int, str]:
    """The exit code of what is told to end so many seconds after its start, and what it said."""
    process = subprocess.Popen(
        words,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        env={**os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF'},
    )
    try:
        time.sleep(after)
        process.send_signal(number)
        said = process.communicate(timeout=PATIENCE)[0]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    return process.returncode, said.decode(errors='replace')


@pytest.mark.parametrize('name', STARTED)
def test_a_signal_ends_it_at_any_moment_with_the_documented_code(name, tmp_path):
    words, code = STARTED[name]
    rng = random.Random(f'{name} 16')
    for number in (signal.SIGINT, signal.SIGTERM):
        # from the first millisecond on, for as long as it loads, and at work
        for after in (0.02, rng.uniform(0.05, 0.5), rng.uniform(0.5, 3.0)):
            output = [] if name in ('solver', 'arm', 'recover') else ['--output', 'out']
            start = [str(STANDIN), 'run', *map(str, words), *output]
            found, said = ended(start, tmp_path, number, after)
            done = name == 'recover' and found == 0
            assert found == code or done, f'{number.name} after {after:.3f} s: {found}, {said}'
            assert 'Traceback' not in said, f'{number.name} after {after:.3f} s: {said}'
            if not done:
                assert list(tmp_path.iterdir()) == [], f'{number.name} after {after:.3f} s'
            else:
                (tmp_path / 'out' / 'metadata.yaml').unlink()
                (tmp_path / 'out' / 'out_0.mcap').unlink()
                (tmp_path / 'out').rmdir()


@pytest.mark.parametrize('name', ['solver', 'identify'])
def test_ctrl_c_ends_also_what_a_script_has_put_into_the_background(name, tmp_path):
    """Its shell has SIGINT ignored there, and the script says `kill -INT $!`."""
    words, code = STARTED[name]
    start = ' '.join([str(STANDIN), 'run', *map(str, words)])
    script = f'{start} & sleep 1.7; kill -INT $!; wait $!'
    ran = subprocess.run(['bash', '-c', script], cwd=tmp_path, timeout=PATIENCE, check=False)
    assert ran.returncode == code


def test_a_signal_when_the_work_is_done_changes_no_exit_code(tmp_path):
    """Python gives the signals back before it has taken its modules down."""
    for after in (0.01, 0.03):  # s after the last line
        out = tmp_path / f'after_{after}'
        words = [str(STANDIN), 'run', *map(str, STARTED['recover'][0][:-1]), str(out)]
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
