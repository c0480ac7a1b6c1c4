# SPDX-License-Identifier: Apache-2.0
"""Requests, each worked on in a process of its own: so many at a time, ended when told to."""

from __future__ import annotations

import math
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from types import ModuleType, SimpleNamespace
from typing import Any

from calib_model.errors import CalibrationError
from calib_model.files import confined
from calib_solver.results import Record
from calib_solver.serving.opened import Opened

Work = Callable[[Any, Opened], Record]
AT_ONCE, LONG = 8, 4  # requests under way, and identifications among them
WAITING = 16  # requests that wait for one to end; what comes then is refused
MEMORY = 2 << 30  # bytes that a worker may take
LOOK = 0.1  # s between two looks at a worker
PATIENCE = 5.0  # s of work after which others' requests come first
NICE = 10
NEEDED = 'calib_solver.serving.work'  # what every worker loads
GRACE = 2.0  # s that a worker has for taking down what it has begun


_starting = threading.Lock()


class EndedError(CalibrationError):
    """Work was ended before it was done."""


@dataclass(eq=False)
class _Job:
    """A request from when it comes to its answer."""

    long: bool
    limit: float
    since: float = field(default_factory=time.monotonic)
    under_way: bool = False
    ended: str = ''  # why it is not to go on

    def reason(self) -> str:
        """Why it is to end; '' while it is to go on."""
        if not self.ended and time.monotonic() - self.since > self.limit:
            self.ended = f'time_limit: ended after {self.limit:g} s, before it was done'
        return self.ended


class Workers:
    """Takes requests from any thread."""

    def __init__(self) -> None:
        self._jobs: list[_Job] = []
        self._change = threading.Condition()
        self._closed = ''
        # forked from a server that has one thread and has loaded what they need: at once there, and
        # free of this process' threads
        self._context = get_context('forkserver')
        self._context.set_forkserver_preload([NEEDED])

    def run(
        self, work: Work, request: Any, opened: Opened, limit: float = math.inf, long: bool = False
    ) -> Record:
        """The record that `work` makes of a request, a mapping of its fields, within `limit` s.

        Raises:
            CalibrationError: what `work` raises; it was ended before it was done; too many wait.
        """
        job = _Job(long, limit if limit > 0 else math.inf)
        try:
            self._wait_for_turn(job)
            return self._done(job, (work, request, opened))
        finally:
            with self._change:
                if job in self._jobs:
                    self._jobs.remove(job)
                self._change.notify_all()

    def cancel(self) -> int:
        """End all that is under way or waits; returns how many that are."""
        return self._end('cancelled: ended before it was done, as /solver/cancel asked')

    def close(self) -> None:
        """End everything for good."""
        self._closed = 'cancelled: the solver ends'
        self._end(self._closed)

    def idle(self) -> bool:
        """Whether no request is under way or waits."""
        return not self._jobs

    def _end(self, why: str) -> int:
        with self._change:
            for job in self._jobs:
                job.ended = job.ended or why
            self._change.notify_all()
            return len(self._jobs)

    def _wait_for_turn(self, job: _Job) -> None:
        with self._change:
            busy = sum(one.under_way for one in self._jobs)
            if len(self._jobs) - busy >= WAITING:
                raise CalibrationError(
                    f'busy: {busy} requests are under way and {WAITING} wait, the most that may; '
                    'ask again later'
                )
            job.ended = self._closed
            self._jobs.append(job)
            while not job.reason() and not self._may_begin(job):
                self._change.wait(LOOK)
            if job.ended:
                raise EndedError(job.ended)
            job.under_way = True

    def _may_begin(self, job: _Job) -> bool:
        """First come, first served; but identifications leave room for others."""
        going = [one for one in self._jobs if one.under_way]
        before = self._jobs[: self._jobs.index(job)]
        if len(going) >= AT_ONCE or any(
            not one.under_way and one.long == job.long for one in before
        ):
            return False
        return not job.long or sum(one.long for one in going) < LONG

    def _done(self, job: _Job, task: tuple[Work, Any, Opened]) -> Record:
        receiver, sender = self._context.Pipe(duplex=False)
        process = self._context.Process(target=_work, args=(sender, *task))
        with receiver:
            try:
                with sender, _no_main():
                    process.start()
            except OSError as error:
                raise CalibrationError(f'no worker can be started: {error}') from error
            try:
                return _answer(job, process, receiver)
            finally:
                _end(process)


def _answer(job: _Job, process: BaseProcess, receiver: Connection) -> Record:
    began, first = time.monotonic(), True
    while not wait([receiver], LOOK):
        if job.reason():
            raise EndedError(job.ended)
        if first and time.monotonic() - began > PATIENCE and process.pid is not None:
            first = False
            with suppress(ProcessLookupError):
                os.setpriority(os.PRIO_PROCESS, process.pid, NICE)
    try:
        record, refusal = receiver.recv()
        process.join(GRACE)  # it has nothing left to do
    except EOFError:
        process.join(GRACE)
        raise CalibrationError(
            f'the work ended unexpectedly ({_how(process.exitcode)}); the log of the node may '
            'say more'
        ) from None
    if refusal is not None:
        raise CalibrationError(refusal)
    return dict(record)


@contextmanager
def _no_main() -> Iterator[None]:
    """Within, a process that is started has no main module to load: the node's would bring ROS."""
    with _starting:
        main = sys.modules['__main__']
        sys.modules['__main__'] = ModuleType('__main__')
        try:
            yield
        finally:
            sys.modules['__main__'] = main


def _how(code: int | None) -> str:
    if code == -signal.SIGKILL:
        return 'killed, as the system does when memory runs out'
    return f'exit code {code}'


def _end(process: BaseProcess) -> None:
    """What is at work is told to end, and then made to."""
    if process.exitcode is None:
        process.terminate()
        process.join(GRACE)
    if process.exitcode is None:
        process.kill()
    process.join()
    process.close()


def _work(sender: Connection, work: Work, request: dict[str, Any], opened: Opened) -> None:
    """In a worker, which may be told to end at any moment."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is the node's to answer Ctrl-C
    try:
        signal.signal(signal.SIGTERM, _interrupted)
        try:
            sender.send(_answered(work, request, opened))
        finally:
            signal.signal(signal.SIGTERM, signal.SIG_IGN)
    except KeyboardInterrupt:
        return


def _answered(
    work: Work, request: dict[str, Any], opened: Opened
) -> tuple[dict[str, Any] | None, str | None]:
    """The record of the work, or why there is none."""
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        with confined(opened.reading, opened.writing):
            return work(SimpleNamespace(**request), opened), None
    except CalibrationError as error:
        return None, str(error)
    except MemoryError as error:
        return None, f'not enough memory: {error}'.rstrip(': ')


def _interrupted(number: int, frame: object) -> None:
    signal.signal(number, signal.SIG_IGN)  # what is taken down is taken down once
    raise KeyboardInterrupt


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
