# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture import_points`: a table of measured points becomes a bag."""

from __future__ import annotations

import sys
from pathlib import Path

from calib_capture.commands.point_table import ANGLES, LENGTHS, Units, read_point_table
from calib_model import bags, descriptions, files
from calib_model.command_line import CommandParser, run_command
from calib_model.measured_points import PointMeasurement
from calib_model.progress import Progress

ABOUT = """\
Turn a table of points, as a laser tracker or a camera system measured a target on the flange, into
a bag that identify and evaluate take. No gauge and no probe.

TABLE is CSV with a header line: q1..qn or the joints' own names, and x,y,z of the target in the
tracker's frame. Optional: its orientation there, qx,qy,qz,qw or rx,ry,rz (a rotation vector);
target, its name or number, as each has its own unknown place on the flange; station, the number of
the tracker's place, as each has its own unknown placement (both 1 unless given); sigma, the
standard uncertainty of a coordinate."""

EXAMPLE = """\
example:
  ros2 run calib_capture import_points tracker.csv bags/tracker --arm arms/kuka_lbr_iiwa14.yaml \\
    --length mm --angle deg
  ros2 run calib_solver identify bags/tracker --output output/tracker"""


def import_points(table: Path, out: Path, arm_file: Path, units: Units) -> PointMeasurement:
    """Write the bag `out` from a table and an arm's description; whole or not at all.

    Raises:
        TableError: names the line and the column that cannot be used.
        DescriptionError: the description cannot be used.
        BagError: there is something at `out` already, or it cannot be written.
    """
    files.refuse_taken(out)
    arm = descriptions.read_description(arm_file, descriptions.parse_arm)
    points = read_point_table(table, arm, units)
    measured = PointMeasurement(arm, points, str(table)).checked()
    with files.made_whole(out) as part:
        bags.write_points(part, measured, Progress(sys.stderr))
    return measured


def main() -> int:
    """The command."""
    return run_command(_import)


def _import() -> None:
    parser = CommandParser('import_points', ABOUT, EXAMPLE)
    parser.add_argument('table', metavar='TABLE.csv', type=Path)
    parser.add_argument('out', metavar='OUT_BAG', type=Path, help='folder to make')
    parser.add_argument(
        '--arm', type=Path, required=True, metavar='A.yaml', help='description of the arm'
    )
    parser.add_argument(
        '--length', choices=tuple(LENGTHS), default='m', help='unit of x,y,z,sigma (default: m)'
    )
    parser.add_argument(
        '--angle',
        choices=tuple(ANGLES),
        default='rad',
        help='unit of the joints and of rx,ry,rz (default: rad)',
    )
    given = parser.parse_args()
    units = Units(LENGTHS[given.length], ANGLES[given.angle])
    measured = import_points(given.table, given.out, given.arm, units)
    points = measured.points
    targets, stations = len(set(points.target.tolist())), len(set(points.station.tolist()))
    oriented = int(points.oriented.sum())
    print(
        f'{given.out}: {len(points)} points of {measured.arm.name}, '
        f'{targets} target{"s" if targets > 1 else ""} seen from '
        f'{stations} station{"s" if stations > 1 else ""}'
        + (f', {oriented} with orientation' if oriented else '')
    )


if __name__ == '__main__':
    sys.exit(main())
