# SPDX-License-Identifier: Apache-2.0
"""How much memory another process has held. rusage counts what its parent held at the fork, too."""

import re
from pathlib import Path


def high_water(number: int) -> int:
    """The most bytes that the process of that number has held so far; 0 when it is gone."""
    try:
        status = Path(f'/proc/{number}/status').read_text()
    except OSError:
        return 0
    found = re.search(r'VmHWM:\s+(\d+) kB', status)
    return int(found[1]) * 1024 if found else 0
