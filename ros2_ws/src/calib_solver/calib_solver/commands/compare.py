# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver compare`: what changed between calibrations, and what is chance."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from calib_model.command_line import CommandParser, run_command
from calib_solver import acceptance

ABOUT = """\
Tell what changed between calibrations of one arm, in the order of their dates: parameters and
positions over the workspace against their joint uncertainty. What two calibrations have in common,
as the gauge's certificate, is not counted as a difference. Where nothing changed, 5 % of
comparisons say that something did."""
EXAMPLE = """\
example:
  ros2 run calib_solver compare output/spring output/autumn --output output/drift
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""

    def work() -> None:
        parser = CommandParser('compare', ABOUT, EXAMPLE)
        parser.add_argument(
            'result', nargs='+', metavar='DIR', help='folders of `identify --output`, two or more'
        )
        parser.add_argument('--json', action='store_true', help='JSON on stdout, SI units')
        parser.add_argument(
            '--output', default='', metavar='DIR', help='write comparison.html there'
        )
        given = parser.parse_args(argv)
        found = acceptance.compare(given.result)
        written = [acceptance.write_comparison(found, given.output)] if given.output else []
        if given.json:
            print(json.dumps(found.record(), indent=1, allow_nan=False))
            return
        print('\n'.join([*acceptance.history_lines(found), *(f'wrote {path}' for path in written)]))

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
