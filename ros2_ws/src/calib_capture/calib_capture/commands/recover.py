# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture recover`: a bag cut short or damaged becomes one that opens."""

from __future__ import annotations

import sys
from pathlib import Path

from calib_model import bags
from calib_model.command_line import CommandParser, run_command
from calib_model.errors import printable
from calib_model.progress import Progress

LOSSY = 3

ABOUT = """\
Copy what is whole in a damaged bag to a new one. A capture that was killed leaves a bag without
its end: every complete chunk of it comes back, and with it every pose that was acknowledged.

Exit code 0 when nothing is missing, 3 when something is or may be, 2 when nothing can be had."""

EXAMPLE = """\
example:
  ros2 run calib_capture recover output/cut_bag output/recovered_bag"""


def main() -> int:
    """The command."""
    return run_command(_recover)


def _recover() -> int:
    parser = CommandParser('recover', ABOUT, EXAMPLE)
    parser.add_argument('bad', metavar='BAD', type=Path, help="a bag's folder, .mcap or .db3 file")
    parser.add_argument('out', metavar='OUT', type=Path, help='folder to make')
    given = parser.parse_args()
    found = bags.recover(given.bad, given.out, Progress(sys.stderr))
    for topic, count in sorted(found.counts.items()):
        print(f'{count:>9} {printable(topic)}')
    print(f'{given.out}: {found.messages} messages recovered, missing: {found.loss()}')
    return LOSSY if found.lossy else 0


if __name__ == '__main__':
    sys.exit(main())
