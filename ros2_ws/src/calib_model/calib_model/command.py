# SPDX-License-Identifier: Apache-2.0
"""The edge of every command: errors become one line and an exit code, here and nowhere else."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from calib_model.errors import CalibrationError

BAD_INPUT = 2
INTERRUPTED = 130


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
