# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture place`: where to put the gauge."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from calib_capture import program
from calib_capture.commands.plan import add_files, add_probing, bodies_of, described
from calib_model import files
from calib_model.command_line import CommandParser, number_from, run_command, whole_from
from calib_model.errors import CalibrationError
from calib_model.progress import Progress

MOST_PLACES = 100
FAR = 100.0  # m

ABOUT = """\
Propose places for the gauge in the workspace of an arm and write them for plan and capture: each in
reach and free of collisions, all together the ones that tell most of the arm's parameters. The most
telling comes first; keep one location to test with, and do not identify from it.

Printed with them: how much of each place can be probed, how sure positions are to be expected with
the first, the first two, and so on, and what is in the way elsewhere."""

EXAMPLE = """\
example:
  ros2 run calib_capture place --arm my_arm.yaml --gauge my_gauge.yaml places.yaml --count 4"""


def main() -> int:
    """The command."""
    return run_command(_place)


def _place() -> None:
    parser = CommandParser('place', ABOUT, EXAMPLE)
    parser.add_argument('out', metavar='OUT.yaml', type=Path, help='file to write')
    add_files(parser, ('arm', 'probe', 'gauge'))
    parser.add_argument(
        '--count',
        type=whole_from(1, MOST_PLACES),
        default=8,
        metavar='N',
        help='locations to find (default: %(default)s)',
    )
    parser.add_argument(
        '--region',
        type=number_from(-FAR, FAR),
        nargs=6,
        metavar=('X0', 'X1', 'Y0', 'Y1', 'Z0', 'Z1'),
        help="m in the arm's base frame, which the whole gauge has to be in (default: anywhere)",
    )
    add_probing(parser)
    given = parser.parse_args()
    arm, probe, gauge = described(given)
    settings = program.ProgramSettings(
        spheres=tuple(given.spheres or ()),
        poses_per_sphere=1,
        pool=1,
        cap=np.radians(given.cap),
        approach=given.approach,
        bodies=bodies_of(given),
        seed=given.seed,
    )
    region = np.array(given.region).reshape(3, 2) if given.region else None
    planner = program.Planner(arm, probe, gauge, settings)
    placed = program.Placer(planner, region).place(given.count, Progress(sys.stderr))
    try:
        files.write_whole(given.out, program.placed_yaml(placed, planner))
    except OSError as error:
        raise CalibrationError(f'{given.out}: cannot be written: {error.strerror}') from error
    for line in program.placed_text(placed, planner):
        print(line)


if __name__ == '__main__':
    sys.exit(main())
