# SPDX-License-Identifier: Apache-2.0
"""Every command that README and docs show does what they say, as written, in their order.

Each document gets a working folder of its own with the clone's files and those of a user's robot.
What runs until Ctrl-C runs beside what follows in its block, and is ended with it.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
from documented_commands import (
    ROOT,
    Command,
    command_blocks,
    documents,
    furnish,
    python_blocks,
)

from calib_bringup.domains import held_domain

#: what is not run here: why, and the test that has it
ELSEWHERE = {
    r'ros2 launch ': ('needs a full ROS 2 install', 'test_launch_files.py'),
    r'ros2 security |--enclave |ROS_SECURITY': (
        'the wheels have no plugins',
        'test_security_policy.py',
    ),
    r'ros2 bag record': ('needs a full ROS 2 install', 'test_raw_bags.py'),
    r'calib_capture check': ('needs a probe on a sphere', 'test_check.py'),
    r'calib_capture capture_points': ('needs a tracker', 'test_tracked_live.py'),
    r'rviz2': ('needs a full ROS 2 install and a screen', 'test_launch_files.py'),
    r'colcon build|rosdep ': ('every set-up builds', 'test_setup.py'),
    r"pip install '?\.": ('a wheel is built once', 'test_wheel.py'),
    r'(python3? -m )?pip install|git clone': ('every set-up installs', 'test_setup.py'),
    r'python -m studies\.': ('takes minutes', 'test_studies.py'),
    r'dask ': ('a cluster', '../ros2_ws/src/calib_solver/test/resampling/test_cluster.py'),
}
#: run to its end elsewhere; here make says what it would do
DRY = {
    'demo': 'test_demo_variants.py',
    'test': 'test_setup.py',
    'bench': 'test_benchmarks.py',
    'studies': 'test_studies.py',
}
STAYS = re.compile(
    r'ros2 run (calib_capture (sim_)?arm|selfcenter_probe ((sim_)?probe|operator)'
    r'|calib_solver solver)\b'
    r'|\bserve:=true|gauge:=GAUGE\.yaml|--loop|ros2 topic (hz|echo (?!.*--once))'
)
STEPPED = 'time_scale:=0.0'
MAY_BE_CUT = re.compile(r'ros2 run calib_capture (capture|replay)\b')
READY, PATIENCE, MAY_TAKE, CUT_AFTER = 10.0, 15.0, 60.0, 5.0  # s
INTERRUPTED = 130
pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]  # a document is long, a machine busy


@pytest.fixture(scope='module')
def environment(tmp_path_factory) -> dict[str, str]:
    """What a shell that has sourced env.bash passes on, in a domain of this run's own."""
    listing = subprocess.run(
        ['bash', '-c', f'source {ROOT}/env.bash && env -0'],
        check=True,
        capture_output=True,
        text=True,
    )
    variables = dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)
    # what `pip install .` puts on the path
    calib = tmp_path_factory.mktemp('bin') / 'calib'
    calib.write_text('#!/bin/sh\nexec python -m calib_model.commands.calib "$@"\n')
    calib.chmod(0o755)
    return variables | {
        'PATH': f'{calib.parent}:{variables["PATH"]}',
        'ROS_DOMAIN_ID': str(held_domain()),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'PYTHONUNBUFFERED': '1',
        'OMP_NUM_THREADS': '1',
    }


@pytest.fixture(scope='module')
def furnished(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('furnished')
    furnish(folder)
    return folder


@pytest.fixture
def clone(furnished, tmp_path) -> Path:
    return Path(shutil.copytree(furnished, tmp_path / 'clone', symlinks=True))


class Shells:
    """The shells that a user has open while he follows a block of commands."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._environment = environment
        self._staying: list[tuple[Command, subprocess.Popen[str], Path]] = []
        self._count = 0

    def run(self, command: Command) -> None:
        """A command to its end; one that stays is left running."""
        process, log = self._started(command)
        if STAYS.search(command.text) and '--help' not in command.text:
            self._staying.append((command, process, log))
            self._until_it_speaks(process, log)
            return
        # in real time a program takes long, and so does a bag: Ctrl-C in its midst
        cut = MAY_BE_CUT.search(command.text) is not None and not any(
            STEPPED in each.text for each, _, _ in self._staying
        )
        try:
            code = process.wait(CUT_AFTER if cut else MAY_TAKE)
        except subprocess.TimeoutExpired:
            code = _ended(process)
            assert cut, f'{command.place}: {command.text}: not done: {log.read_text()}'
        expected = (0, INTERRUPTED) if cut else (0,)
        assert code in expected, f'{command.place}: {command.text}: {code}: {log.read_text()}'

    def close(self) -> None:
        """Ctrl-C in those that are left; none may have ended by itself."""
        for command, process, log in self._staying:
            early = process.poll()
            code = _ended(process)
            said = f'{command.place}: {command.text}: {log.read_text()}'
            assert early is None, f'ended by itself: {said}'
            assert code in (0, INTERRUPTED, -signal.SIGINT), f'{code}: {said}'
        self._staying.clear()

    def abandon(self) -> None:
        """End what is left, whatever it says."""
        for _, process, _ in self._staying:
            _ended(process)

    def _started(self, command: Command) -> tuple[subprocess.Popen[str], Path]:
        self._count += 1
        log = self._folder.parent / f'{self._count}.log'
        text = re.sub(r'^make\b', 'make -n', command.text)
        with log.open('w', encoding='utf-8') as stream:
            process = subprocess.Popen(
                ['bash', '-c', text],
                cwd=self._folder,
                env=self._environment,
                text=True,
                stdin=subprocess.DEVNULL,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        return process, log

    def _until_it_speaks(self, process: subprocess.Popen[str], log: Path) -> None:
        end = time.monotonic() + READY
        while not log.stat().st_size and process.poll() is None and time.monotonic() < end:
            time.sleep(0.05)


def _ended(process: subprocess.Popen[str]) -> int:
    """The exit code after Ctrl-C, which a terminal sends to all processes of a command."""
    for number in (signal.SIGINT, signal.SIGKILL):
        if process.poll() is None:
            os.killpg(process.pid, number)
        try:
            return process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            continue
    raise AssertionError('a process that SIGKILL does not end')


def elsewhere(command: Command) -> bool:
    return any(re.search(pattern, command.text) for pattern in ELSEWHERE)


@pytest.mark.parametrize('document', documents(), ids=lambda path: path.name)
def test_the_commands_of_a_document_work_as_written(document, clone, environment):
    shells = Shells(clone, environment)
    try:
        for block in command_blocks(document):
            for command in block:
                if not elsewhere(command):
                    shells.run(command)
            shells.close()
    finally:
        shells.abandon()


def test_the_python_of_the_documents_works_as_written(clone, environment):
    shown = [text for document in documents() for text in python_blocks(document)]
    assert shown
    for text in shown:
        done = subprocess.run(
            [sys.executable, '-c', text],
            cwd=clone,
            env=environment,
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert done.returncode == 0, done.stderr


def test_what_is_not_run_here_has_a_test_elsewhere():
    tests = Path(__file__).parent
    for name in [test for _, test in ELSEWHERE.values()] + list(DRY.values()):
        assert (tests / name).exists(), name
    made = {
        word
        for document in documents()
        for block in command_blocks(document)
        for command in block
        if command.text.startswith('make ')
        for word in command.text.split()[1:2]
    }
    assert made - {'soak'} <= set(DRY)


def test_commands_are_found_in_readme_and_docs():
    found = [
        command.text
        for document in documents()
        for block in command_blocks(document)
        for command in block
    ]
    assert {'make demo', 'make test'} <= set(found)
    assert sum(not elsewhere(Command(text, '')) for text in found) > 20
