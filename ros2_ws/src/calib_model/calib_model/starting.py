# SPDX-License-Identifier: Apache-2.0
"""From a command's or node's first moment to its last: what a signal that asks it to end does.

`commands/__init__.py` and `nodes/__init__.py` of each package call `begin`, before anything that
takes time is loaded: nothing has been begun by then, so the process may end where it stands.
`run_command` and `run_node` take over from there. `ros2 run` may start a process with these signals
held back; they are let in here.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.machinery import ExtensionFileLoader
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTED = 130
AGAIN = 1e-3  # s after which an interrupt that came to nothing comes again, and again
LATEST = 4.0  # s after which a process that was asked to end does, whatever it is at
#: what runs while the library of an extension module is opened, and while the module is made of it
_LOADING = (
    ExtensionFileLoader.create_module.__code__,
    ExtensionFileLoader.exec_module.__code__,
)


class _Program:
    """What this process ends with when it is asked to; None where it is no program of ours."""

    code: int | None = None


def begin(room: str, code: int = INTERRUPTED) -> None:
    """End with exit code `code` on SIGINT, SIGTERM or SIGHUP from now on, where the process is a
    command or node of `room` (`package.commands`, `package.nodes`) and not one that imports it."""
    if not is_program(room):
        return
    if _Program.code is None:
        _Program.code = code
    for number in ENDING:
        ours = [signal.SIG_DFL, signal.default_int_handler]
        if number == signal.SIGINT:  # a script's `node & kill -INT $!`: its shell has it ignored
            ours.append(signal.SIG_IGN)
        if signal.getsignal(number) in ours:
            signal.signal(number, lambda *_: os._exit(code))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


def begun() -> bool:
    """Whether this process is a command or node of ours, so that its signals are ours."""
    return _Program.code is not None


def ending_code() -> int:
    """The exit code of this process where it is asked to end before its work is done."""
    return INTERRUPTED if _Program.code is None else _Program.code


def is_program(room: str) -> bool:
    """Whether this process was started as a command or node of `room`; a worker process was not."""
    worker = sys.modules.get('multiprocessing.process')
    if worker is not None and worker.parent_process() is not None:
        return False
    module = _module()
    if module:
        return module == room or module.startswith(f'{room}.')
    folder, script = os.path.split(sys.argv[0])
    return script == 'calib' or os.path.basename(folder) == room.partition('.')[0]


def program() -> str:
    """What this process was started as: the script's name, or the module's after `python -m`."""
    return _module().rpartition('.')[2] or os.path.basename(sys.argv[0])


def handle(handler: Callable[[int, FrameType | None], None] | signal.Handlers) -> None:
    """Let `handler` have those of the signals that nobody chose to ignore."""
    for number in ENDING:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


class _HeldBack:
    """How often the main thread is in `held_back`, and whether an interrupt waits for its end."""

    depth = 0
    waiting = False


@contextmanager
def held_back() -> Iterator[None]:
    """Let an interrupt wait until this is over: for what takes moments and leaves something behind
    when it is cut. Other threads are not interrupted anyway."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _HeldBack.depth += 1
    try:
        yield
    finally:
        _HeldBack.depth -= 1
        if _HeldBack.waiting and not _HeldBack.depth:
            _HeldBack.waiting = False
            raise KeyboardInterrupt


def interrupt() -> None:
    """Raise KeyboardInterrupt in the main thread, as soon as nothing is held back and no extension
    module is being loaded: written in C++, it may end the process for an exception that meets it
    there."""
    if not _HeldBack.depth and _loads_an_extension(sys._getframe()):
        interrupt_again()
        return
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if not _HeldBack.depth:
        raise KeyboardInterrupt
    _HeldBack.waiting = True


def interrupt_again() -> None:
    """Let an interrupt that came to nothing come again, a moment later, and as often as it takes:
    one that arrives just before a call that waits is not heard until that call is over."""
    signal.signal(signal.SIGALRM, _come_again)
    signal.setitimer(signal.ITIMER_REAL, AGAIN, AGAIN)


def _come_again(*_: object) -> None:
    if any(signal.getitimer(signal.ITIMER_REAL)):  # else it was on its way as another interrupted
        interrupt()


def _loads_an_extension(frame: FrameType | None) -> bool:
    """Whether a frame is within the loading of an extension module."""
    while frame is not None:
        if frame.f_code in _LOADING:
            return True
        frame = frame.f_back
    return False


def end_at_the_latest() -> None:
    """End a process of ours in `LATEST` s as one that was asked to, unless it has ended by then."""

    def end() -> None:
        time.sleep(LATEST)
        os._exit(ending_code())

    if begun():
        threading.Thread(target=end, daemon=True).start()


def _module() -> str:
    words = sys.orig_argv
    for word, after in zip(words, words[1:], strict=False):
        if word == '-m':
            return after
        if not word.startswith('-') and word != words[0]:
            break
    return ''
