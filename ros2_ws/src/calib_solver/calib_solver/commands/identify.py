# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver identify`: D-H identification (eq. 11) from bags, without a graph."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

from calib_model.command_line import CommandParser, UsageError, run_command
from calib_model.progress import Progress
from calib_solver import calibration, error_models, fitting, report, resampling

#: those of calib_solver.fitting, which takes long to load
OBJECTIVES = ('distance_repeatability', 'distance', 'position')

ABOUT = """\
Identify the Denavit-Hartenberg parameters of an arm, and where the probe sits on its flange,
from bags of probing poses, or of nothing but /joint_states and /probe/displacements (of a ball
seated in sockets /joint_states alone); or, with the places of its targets, from bags of points that
a tracker measured (import_points)."""
EXAMPLE = """example:
  ros2 run calib_solver identify bags/demo --test bags/demo_test --output output/demo
  ros2 run calib_solver identify my_bag --arm arm.yaml --probe probe.yaml --gauge gauge.yaml
"""


def arguments() -> CommandParser:
    """The command line of `identify`."""
    parser = CommandParser('identify', ABOUT, EXAMPLE)
    parser.add_argument(
        'bag',
        nargs='+',
        metavar='BAG',
        help='bag folder or .mcap file; several are one calibration',
    )
    parser.add_argument(
        '--output',
        metavar='DIR',
        default='',
        help='write result.json, arm.yaml, probe.yaml, arm.urdf there',
    )
    parser.add_argument(
        '--objective',
        default='',
        metavar='NAME',
        help=f'one of {", ".join(OBJECTIVES)} (default: {OBJECTIVES[0]}; of measured points '
        f'{OBJECTIVES[-1]})',
    )
    parser.add_argument(
        '--test',
        action='append',
        nargs='+',
        default=[],
        metavar='BAG',
        help='held-out bags to judge by',
    )
    parser.add_argument(
        '--arm', default='', metavar='YAML', help="start from this arm, not the bag's"
    )
    parser.add_argument(
        '--probe', default='', metavar='YAML', help="start from this probe, not the bag's"
    )
    calibration.add_gauge_arguments(parser)
    parser.add_argument(
        '--urdf',
        default='',
        metavar='FILE',
        help="write the user's own URDF with corrected joint origins, robot.urdf, to --output too",
    )
    parser.add_argument(
        '--fix',
        action='append',
        default=[],
        metavar='PATTERN',
        help="hold these parameters, as in --fix 'd*'",
    )
    parser.add_argument(
        '--free',
        action='append',
        default=[],
        metavar='PATTERN',
        help='identify these parameters all the same',
    )
    parser.add_argument(
        '--prior',
        default='',
        metavar='CHOICE',
        help='auto (default): the poses say how wide it is for each kind of parameter; none, a '
        'strength (2 is usual), or a YAML file of standard deviations',
    )
    parser.add_argument(
        '--loss',
        default='rejecting',
        metavar='NAME',
        help='rejecting (default): gross errors are left out and listed; plain: every pose counts',
    )
    parser.add_argument(
        '--joint-errors',
        default='auto',
        metavar='KINDS',
        help='identify encoder, scale (of joints that slide), compliance or several '
        '(encoder,compliance) with the D-H parameters, as far as locations left out get better by '
        'it; auto (default): encoder, scale of an arm on a rail, and compliance where --links is '
        'given; none',
    )
    parser.add_argument(
        '--links',
        default='',
        metavar='FILE',
        help="the links' masses and centres, YAML or URDF, for compliance",
    )
    parser.add_argument(
        '--correction',
        default='off',
        metavar='CHOICE',
        help='of eq. 12, as functions of the joints: off (default); auto: only if locations, or '
        'groups of measured points, left out get better by it; harmonic: in any case',
    )
    parser.add_argument(
        '--quick',
        action='store_true',
        help='no joint errors, no search for mix-ups, no judging by what is left out',
    )
    parser.add_argument(
        '--monte-carlo',
        type=int,
        default=0,
        metavar='N',
        help='check the uncertainties by N identifications with drawn errors',
    )
    parser.add_argument(
        '--bootstrap',
        type=int,
        default=0,
        metavar='N',
        help='check the uncertainties by N identifications on drawn gauge locations',
    )
    parser.add_argument(
        '--seed',
        type=int,
        default=0,
        metavar='K',
        help='of what is drawn (default: %(default)s)',
    )
    parser.add_argument(
        '--scheduler',
        default='',
        metavar='ADDRESS',
        help="spread the work over this Dask scheduler's workers, as in tcp://192.168.0.7:8786; of "
        'measured points the repetitions',
    )
    parser.add_argument(
        '--figures',
        default='',
        metavar='DIR',
        help="draw the report's figures there as PNG, and before_and_after.png",
    )
    calibration.add_raw_arguments(parser)
    return parser


def run(
    argv: Sequence[str] | None = None,
) -> calibration.Calibration | calibration.PointCalibration:
    """Parse a command line and calibrate.

    Raises:
        CalibrationError: anything that keeps it from being done.
    """
    given = arguments().parse_args(argv)
    if given.urdf and not given.output:
        raise UsageError('--urdf needs --output DIR, where robot.urdf is written')
    sources = calibration.Sources(
        tuple(given.bag),
        given.arm,
        given.probe,
        given.gauge,
        given.links,
        calibration.raw_settings(given),
        given.raw,
        calibration.given_temperature(given),
    )
    points = calibration.hold_points(sources)
    options = fitting.Options(
        given.objective or OBJECTIVES[-1 if points else 0],
        tuple(given.fix),
        tuple(given.free),
        fitting.chosen_prior(given.prior),
        given.loss,
        given.correction,
        error_models.chosen_kinds(given.joint_errors),
        quick=given.quick,
    )
    test = [bag for group in given.test for bag in group]
    plan = resampling.Plan(given.monte_carlo, given.bootstrap, given.seed)
    effort = calibration.Effort(
        plan, given.scheduler, Progress(sys.stderr, 'repetitions'), Progress(sys.stderr, 'MB')
    )
    if points:
        by_points = calibration.calibrate_points(
            sources, options, test, given.output, effort, given.urdf
        )
        if given.figures:
            drawn = report.save_point_figures(by_points.done, given.figures, by_points.held_out)
            by_points = replace(by_points, written=(*by_points.written, *drawn))
        return by_points
    finished = calibration.calibrate(sources, options, test, given.output, effort, given.urdf)
    if given.figures:
        drawn = report.save_figures(finished.done, given.figures, finished.held_out)
        finished = replace(finished, written=(*finished.written, *drawn))
    return finished


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""

    def work() -> None:
        finished = run(argv)
        if isinstance(finished, calibration.Calibration):
            print(calibration.summary_text(finished))
        else:
            print(calibration.point_summary_text(finished))

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
