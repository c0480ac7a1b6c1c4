# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver compensate`: targets become the joint commands that really get there."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from calib_model.command_line import CommandParser, run_command
from calib_solver import compensation

UNREACHED = 1

ABOUT = """\
Turn targets into the joint commands that really get there, by the arm that identify found.

RESULT is the folder of `identify --output`. TABLE.csv has a header line, SI units, and either
x,y,z of the tool in the base frame, with rx,ry,rz (rotation vector) or qx,qy,qz,qw where the tool's
orientation counts and q1..qn where a posture to start from is known; or q1..qn alone, the joint
trajectory that the nominal controller would run. OUT.csv gets q1..qn, row by row."""
EXAMPLE = """\
example:
  ros2 run calib_solver compensate output/mine targets.csv joints.csv
  ros2 run calib_solver compensate output/mine program.csv joints.csv --tool 0,0,0.15
"""


def run(argv: Sequence[str] | None = None) -> compensation.Finished:
    """Parse a command line and compensate.

    Raises:
        CalibrationError: anything that keeps it from being done.
    """
    parser = CommandParser('compensate', ABOUT, EXAMPLE)
    parser.add_argument('result', metavar='RESULT')
    parser.add_argument('table', metavar='TABLE.csv')
    parser.add_argument('output', metavar='OUT.csv')
    parser.add_argument(
        '--tool',
        default='probe',
        metavar='TOOL',
        help="what is brought to the targets: 'probe' (default) is the identified probe, "
        "'flange' the flange, x,y,z[,rx,ry,rz] a tool whose place on the flange is known (m, rad)",
    )
    parser.add_argument(
        '--position-only', action='store_true', help='the tool may turn as it likes'
    )
    given = parser.parse_args(argv)
    return compensation.compensate_file(
        given.result, given.table, given.output, given.tool, given.position_only
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0; 1 where a row is not reached; or 2 and one line on stderr."""

    def work() -> int:
        finished = run(argv)
        for note in finished.notes:
            print(note, file=sys.stderr)
        print(finished.verdict)
        return UNREACHED if finished.done.unreached else 0

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
