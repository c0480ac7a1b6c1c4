# SPDX-License-Identifier: Apache-2.0
"""Nodes and commands as processes of their own, on a graph of their own, that end with ours."""

from __future__ import annotations

import ctypes
import fcntl
import os
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Sequence
from pathlib import Path

from calib_model.errors import CalibrationError
from calib_model.starting import LATEST

PR_SET_PDEATHSIG = 1
#: s between asking a process to end and making it: who was told to end has time left to tidy up
PATIENCE = LATEST - 1.0


class ChildError(CalibrationError):
    """A process that ended when or how it should not; its own line says why."""


def graph_environment(domain: int) -> dict[str, str]:
    """Our environment, but for a graph of its own that stays on this machine."""
    apart = {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    inherited = {k: v for k, v in os.environ.items() if k != 'ROS_STATIC_PEERS'}
    return {**inherited, **apart, 'PYTHONUNBUFFERED': '1'}


def _end_with_parent() -> None:
    """Ask Linux to end this process when its parent is gone, even by SIGKILL."""
    if sys.platform == 'linux':
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _on_terminal() -> None:
    """Be in front on the terminal that is read."""
    _end_with_parent()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


class Child:
    """A Python module run as a process in the folder of its log.

    What it prints goes to the log too, unless it is to be `shown`. It reads what is typed on a
    `terminal`, given as a file descriptor, where there is one.
    """

    def __init__(
        self,
        name: str,
        module: str,
        arguments: Sequence[str],
        env: dict[str, str],
        log: Path,
        shown: bool = False,
        terminal: int | None = None,
    ) -> None:
        self.name = name
        self._log = log
        with log.open('w', encoding='utf-8') as stream:
            self.process = subprocess.Popen(
                [sys.executable, '-m', module, *arguments],
                stdin=subprocess.DEVNULL if terminal is None else terminal,
                stdout=None if shown else stream,
                stderr=stream,
                env=env,
                cwd=log.parent,
                start_new_session=terminal is not None,
                preexec_fn=_end_with_parent if terminal is None else _on_terminal,
            )

    def complaint(self) -> ChildError:
        """The error that passes on the last line that the process left."""
        lines = self._log.read_text(encoding='utf-8', errors='replace').split('\n')
        said = [line for line in lines if line.strip()]
        code = self.process.returncode
        return ChildError(f'{self.name}: {said[-1]}' if said else f'{self.name} ended with {code}')


class Children:
    """Processes that are all ended when the block is left, however that comes."""

    def __init__(self) -> None:
        self._running: list[Child] = []

    def start(self, child: Child) -> Child:
        """Look after a process from now on."""
        self._running.append(child)
        return child

    def wait(self, child: Child, seconds: float, done: tuple[int, ...] = (0,)) -> None:
        """Until a process has done its work, as the exit codes `done` say; the others must live on
        meanwhile.

        Raises:
            ChildError: it failed, took longer than `seconds`, or another one died.
        """
        end = time.monotonic() + seconds
        while child.process.poll() is None:
            for other in self._running:
                if other is not child and other.process.poll() not in (None, 0):
                    raise other.complaint()
            if time.monotonic() > end:
                raise ChildError(f'{child.name} is not done after {seconds:.0f} s')
            time.sleep(0.02)
        if child.process.returncode not in done:
            raise child.complaint()
        self._running.remove(child)

    def __enter__(self) -> Children:
        return self

    def __exit__(self, *_: object) -> None:
        left = [child.process for child in self._running if child.process.poll() is None]
        for process in left:
            process.terminate()
        end = time.monotonic() + PATIENCE
        for process in left:
            try:
                process.wait(max(end - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
