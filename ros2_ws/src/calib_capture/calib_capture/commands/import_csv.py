# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture import_csv`: a table of probing poses becomes a bag."""

from __future__ import annotations

import sys
from pathlib import Path

from calib_capture.commands.pose_table import read_table
from calib_model import bags, descriptions, files
from calib_model.command_line import CommandParser, run_command
from calib_model.measurement import Measurement, group_by_sphere
from calib_model.progress import Progress

ABOUT = """\
Turn a table of probing poses into a bag that identify and evaluate take.

TABLE is CSV with a header line: location,sphere,q1..qn and, for an active probe, s1,s2,s3.
Joints in rad, stylus displacements in m, locations counted from 1, spheres as on the gauge's
certificate. The descriptions are those of calib_bringup/config or your own."""

EXAMPLE = """\
example:
  ros2 run calib_capture import_csv front.csv front_bag --arm arms/kuka_lbr_iiwa14.yaml \\
    --probe probes/seated_ball_iiwa14.yaml --gauge gauges/two_sockets.yaml"""


def import_csv(
    table: Path, out: Path, arm_file: Path, probe_file: Path, gauge_file: Path
) -> Measurement:
    """Write the bag `out` from a table and three description files; whole or not at all.

    Raises:
        TableError: names the line and the column that cannot be used.
        DescriptionError: a description cannot be used.
        DataError: readings that fit no sphere of the gauge.
        BagError: there is something at `out` already, or it cannot be written.
    """
    files.refuse_taken(out)
    arm = descriptions.read_description(arm_file, descriptions.parse_arm)
    probe = descriptions.read_description(probe_file, descriptions.parse_probe)
    gauge = descriptions.read_description(gauge_file, descriptions.parse_gauge)
    poses = read_table(table, arm, probe, gauge)
    measured = Measurement(arm, probe, gauge, poses, str(table)).checked()
    with files.made_whole(out) as part:
        bags.write_measurement(part, measured, Progress(sys.stderr))
    return measured


def main() -> int:
    """The command."""
    return run_command(_import)


def _import() -> None:
    parser = CommandParser('import_csv', ABOUT, EXAMPLE)
    parser.add_argument('table', metavar='TABLE.csv', type=Path)
    parser.add_argument('out', metavar='OUT_BAG', type=Path, help='folder to make')
    for name in ('arm', 'probe', 'gauge'):
        parser.add_argument(
            f'--{name}',
            type=Path,
            required=True,
            metavar=f'{name[0].upper()}.yaml',
            help=f'description of the {name}',
        )
    given = parser.parse_args()
    measured = import_csv(given.table, given.out, given.arm, given.probe, given.gauge)
    spheres, _ = group_by_sphere(measured.poses.location, measured.poses.sphere)
    locations = len(set(spheres[:, 0].tolist()))
    print(
        f'{given.out}: {len(measured.poses)} poses of {measured.arm.name} with '
        f'{measured.probe.name}, {len(spheres)} spheres of {measured.gauge.name} '
        f'probed at {locations} location{"s" if locations > 1 else ""}'
    )


if __name__ == '__main__':
    sys.exit(main())
