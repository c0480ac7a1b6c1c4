# SPDX-License-Identifier: Apache-2.0
"""The edge of every command: errors become one line and an exit code, here and nowhere else."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable
from typing import NoReturn

from calib_model.errors import CalibrationError

BAD_INPUT = 2
INTERRUPTED = 130


class UsageError(CalibrationError):
    """Arguments that a command does not take."""


class CommandParser(argparse.ArgumentParser):
    """Arguments of a command; wrong ones are a UsageError, so one line and not argparse's three.

    `description` and `epilog` (the example) keep their line breaks. Parse within `run_command`.
    """

    def __init__(self, prog: str, description: str, epilog: str) -> None:
        super().__init__(
            prog=prog, description=description, epilog=epilog, allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )  # fmt: skip

    def error(self, message: str) -> NoReturn:
        """Raise the UsageError."""
        raise UsageError(f'{self.prog}: {message} (--help says more)')


def run_command(work: Callable[[], int | None]) -> int:
    """Do the work of a command and return its exit code.

    `work` returns an exit code, None for 0. A CalibrationError is printed as one line on stderr
    and gives 2; Ctrl-C gives 130; a reader that has gone away (`| head`) ends it quietly.
    """
    try:
        code = work()
        sys.stdout.flush()
    except CalibrationError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # else the interpreter meets the broken pipe again when it flushes at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return code or 0
