# SPDX-License-Identifier: Apache-2.0
"""The edge of every command: errors become one line and an exit code, here and nowhere else."""

from __future__ import annotations

import argparse
import gc
import io
import math
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from threading import current_thread, main_thread
from typing import Any, NoReturn

from calib_model.errors import CalibrationError
from calib_model.starting import (
    ENDING,
    begun,
    end_at_the_latest,
    ending_code,
    handle,
    interrupt,
    interrupt_again,
)

BAD_INPUT = 2
#: objects more than were given back, after which Python looks for garbage
GARBAGE = 100_000
#: the command that starts all others where there is no ROS; argv[0] is then `calib NAME`
CALIB = 'calib'
#: modules that only planning, bending links and checking of a URDF need, from the extra `planning`
PLANNING = {'pinocchio', 'coal', 'eaik', 'ruckig'}


class UsageError(CalibrationError):
    """Arguments that a command does not take."""


class CommandParser(argparse.ArgumentParser):
    """Arguments of a command; wrong ones are a UsageError, so one line and not argparse's three.

    `description` and `epilog` (the example) keep their line breaks, and where `calib` starts the
    command they say so instead of `ros2 run PACKAGE`. Parse within `run_command`.
    """

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=_as_called(f'ros2 run _ {prog}') if _by_calib() else prog,
            description=_as_called(description),
            epilog=_as_called(epilog),
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Raise the UsageError."""
        raise UsageError(f'{self.prog}: {message} (--help says more)')

    def parse_known_args(  # type: ignore[override]
        self, args: Sequence[str] | None = None, namespace: Any = None
    ) -> Any:
        """As argparse does it, but for `--option=--`, of which older ones make an empty list."""
        words = sys.argv[1:] if args is None else list(args)
        for word in words:
            if word.startswith('-') and word.endswith('=--'):
                self.error(f"argument {word[:-3]}: expected a value, got '--'")
        return super().parse_known_args(words, namespace)


def _by_calib() -> bool:
    return sys.argv[0].partition(' ')[0] == CALIB


def _as_called(text: str) -> str:
    return re.sub(r'\bros2 run \w+ ', f'{CALIB} ', text) if _by_calib() else text


def number_from(least: float, most: float) -> Callable[[str], float]:
    """The type of an argument that is a number from `least` to `most`."""

    def read(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f'expected a number from {least:g} to {most:g}, got {text!r}'
            )
        return value

    return read


def whole_from(least: int, most: int) -> Callable[[str], int]:
    """The type of an argument that is a whole number from `least` to `most`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = least - 1
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(
                f'expected a whole number from {least} to {most}, got {text!r}'
            )
        return value

    return read


def run_command(work: Callable[[], int | None]) -> int:
    """Do the work of a command and return its exit code.

    `work` returns an exit code, None for 0. A CalibrationError is printed as one line on stderr
    and gives 2, and so do an optional library that is missing, a system call that failed and too
    little memory; Ctrl-C, SIGTERM and
    SIGHUP give 130; a reader that has gone away (`| head`) ends it quietly.
    """
    told: list[int] = []
    try:
        _end_as_by_ctrl_c(told)
        code = _done(work)
        _mind_no_more(told)  # what comes until then has interrupted
        return code
    except KeyboardInterrupt:
        return ending_code()
    except Exception:
        # what it met on its way may have made another of it: __set_name__ does, up to Python 3.11
        if told:
            return ending_code()
        raise
    finally:
        _mind_no_more(told)


def _done(work: Callable[[], int | None]) -> int:
    if isinstance(sys.stdout, io.TextIOWrapper):
        # names of files need not be text in the encoding of the terminal
        sys.stdout.reconfigure(errors='backslashreplace')
    # a command needs what it makes to its end: looking for garbage takes a tenth of a short one
    gc.set_threshold(GARBAGE, *gc.get_threshold()[1:])
    try:
        try:
            code = work()
        finally:  # after --help, too
            if sys.stdout is not None:  # None where it was closed before
                sys.stdout.flush()
    except CalibrationError as error:
        return _refused(error)
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] not in PLANNING:
            raise
        return _refused(
            CalibrationError('this needs what plans, not installed: pip install pin EAIK ruckig')
        )
    except BrokenPipeError:
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        where = error.filename or 'output'
        return _refused(CalibrationError(f'{where}: {error.strerror or error}'))
    except MemoryError as error:
        return _refused(CalibrationError(f'not enough memory: {error}'.rstrip(': ')))
    return code or 0


def _mind_no_more(told: list[int]) -> None:
    """What is left is the interpreter's end, which undoes handlers but not what is ignored;
    `told` is what came of them."""
    if told:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    if begun():
        handle(signal.SIG_IGN)


def _end_as_by_ctrl_c(told: list[int]) -> None:
    """Let the signals that ask to end, where nobody has other plans with them, unwind what is under
    way; what does not come to an end by that, as a library that swallows it, is ended soon after.
    The one that came is added to `told`.
    """
    if current_thread() is not main_thread():
        return  # a test's: signals are the main thread's

    def end(number: int, frame: object) -> None:
        # what is torn down then is torn down once
        for one in ENDING:
            signal.signal(one, signal.SIG_IGN)
        end_at_the_latest()
        told.append(number)
        _interrupt_again_where_ignored()
        interrupt()

    if begun():
        handle(end)
        return
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, end)


def _interrupt_again_where_ignored() -> None:
    """What an interrupt raises in a callback, as those of Python's import locks, is told and
    ignored, and so it is where a library in C prints what its own imports met: then it comes again
    a moment later."""
    unraisable, uncaught = sys.unraisablehook, sys.excepthook

    def ignored(what: Any) -> None:
        if isinstance(what.exc_value, KeyboardInterrupt):
            interrupt_again()
        else:
            unraisable(what)

    def printed(kind: type[BaseException], value: BaseException, trace: Any) -> None:
        if issubclass(kind, KeyboardInterrupt):
            interrupt_again()
        else:
            uncaught(kind, value, trace)

    sys.unraisablehook, sys.excepthook = ignored, printed


def _refused(error: CalibrationError) -> int:
    print(error, file=sys.stderr)
    return BAD_INPUT


def _discard_output() -> None:
    """Else the interpreter meets a broken pipe or a full disk again when it flushes at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
