# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver report`: the report of a finished calibration, to be signed."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from calib_model.command_line import CommandParser, UsageError, run_command
from calib_solver import acceptance

ABOUT = """\
Make the report of a finished calibration anew, without its bags: report.html, and report.pdf.

INFO.yaml holds what no bag knows and the first page has: number, operator, organisation,
serials: {arm: "123", probe: "7", gauge: "B-14"}, temperature (deg C), notes, and
limits: {distance_max: 1.0e-4, ...} (m) with the names that `verify` takes; the verdict is by the
held-out poses, where there are any."""
EXAMPLE = """\
example:
  ros2 run calib_solver report output/mine --info info.yaml --pdf
"""
PAPERS = ('A4', 'Letter')


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""

    def work() -> None:
        parser = CommandParser('report', ABOUT, EXAMPLE)
        parser.add_argument('result', metavar='DIR', help='folder of `identify --output`')
        parser.add_argument('--info', default='', metavar='YAML', help='for the first page')
        parser.add_argument(
            '--pdf', action='store_true', help='report.pdf too, by a Chromium on this machine'
        )
        parser.add_argument('--paper', default='A4', metavar='SIZE', help='A4 (default) or Letter')
        given = parser.parse_args(argv)
        if given.paper not in PAPERS:
            raise UsageError(f'--paper: expected {" or ".join(PAPERS)}, got {given.paper!r}')
        for path in acceptance.report_anew(given.result, given.info, given.pdf, given.paper):
            print(f'wrote {path}')

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
