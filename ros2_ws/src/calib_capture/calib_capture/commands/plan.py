# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture plan`: the measuring program, to look at before it runs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from calib_capture import measuring, motion, program
from calib_capture.default_files import FILES, configured, refuse_other_arm
from calib_model import descriptions, files
from calib_model.command_line import (
    CommandParser,
    UsageError,
    number_from,
    run_command,
    whole_from,
)
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.progress import Progress

MOST_POSES, MOST_POOL = 100_000, 1000
MOST_STATIONS = 100
SMALLEST = 1e-9  # m, rad
#: what the capture's time depends on, as its parameters are named: range and meaning
MOTION = {
    'speed': (1e-3, 1.0, 'of each joint, share of its limit, by which the time is told'),
    'approach_speed': (1e-3, 2.0, "m/s along the probe's axis"),
    'acceleration': (1e-2, 1e4, 'rad/s^2, limit of joints for which the arm has none'),
    'jerk': (1e-1, 1e6, 'rad/s^3, limit of joints for which the arm has none'),
}

ABOUT = """\
Plan the measuring program that `capture` with the same settings would run, and tell of it: how
many poses each sphere gets in which branch of the arm, which postures were refused and why, how
many ways between poses go around something, how long the capture will take with its other
parameters as they are by default, and how sure positions are to be expected after a calibration
with these poses. --tracker tells as much of points of a target that a laser tracker or a camera
system sees (import_points), in postures anywhere.

Nothing may touch: arm, probe, the gauge where it stands, and the floor, which is the plane on
which the arm is mounted. How thick links are is assumed from the arm's reach; before a real arm
moves give --bodies, as config/bodies/kr5.yaml of calib_bringup, where `floor: -0.4` is one 0.4 m
lower and `floor: null` none."""

EXAMPLE = """\
example:
  ros2 run calib_capture plan --locations 1 2 --poses 20 --pool 5
  ros2 run calib_capture plan --arm ARM.yaml --tracker 2e-5 --poses 100 --output postures.csv"""


def main() -> int:
    """The command."""
    return run_command(_plan)


def _plan() -> None:
    given = _parser().parse_args()
    if given.tracker is not None:
        _plan_for_tracker(given)
        return
    for option in ('target', 'stations', 'turn_noise', 'output'):
        if getattr(given, option) is not None:
            raise UsageError(f'--{option.replace("_", "-")}: goes with --tracker')
    found = planned(given)
    for line in program.program_text(found):
        print(line)
    if few := program.shortfall(found, given.poses, given.between_locations == program.GO):
        print(f'\n{few}')


def _plan_for_tracker(given: argparse.Namespace) -> None:
    for option in ('probe', 'gauge', 'placements', 'locations', 'spheres', *MOTION):
        if getattr(given, option):
            raise UsageError(
                f'--{option.replace("_", "-")}: goes without --tracker; a tracker takes no {option}'
            )
    default = program.TrackerSettings(given.tracker)
    settings = program.TrackerSettings(
        given.tracker,
        given.turn_noise or 0.0,
        default.targets if given.target is None else np.array(given.target),
        given.poses,
        given.pool,
        bodies=bodies_of(given),
        seed=given.seed,
        stations=given.stations or 1,
    )
    if settings.stations > settings.poses:
        raise UsageError(f'--stations: expected no more than the {settings.poses} postures')
    arm = configured('arm', given.arm, descriptions.parse_arm)
    found = program.tracker_program(arm, settings)
    if given.output is not None:
        try:
            files.write_whole(given.output, program.postures_csv(found))
        except OSError as error:
            raise CalibrationError(
                f'{given.output}: cannot be written: {error.strerror}'
            ) from error
    for line in program.tracker_text(found):
        print(line)


def planned(given: argparse.Namespace) -> program.Program:
    """The program of the command's arguments.

    Raises:
        DescriptionError: a file cannot be used.
        ProgramError: there is no such program; says which spheres are out of reach.
    """
    arm, probe, gauge = described(given)
    if not given.placements:
        refuse_other_arm(arm.name)
    placements = configured('placements', given.placements, descriptions.parse_placements)
    standing = configured('arm', given.arm, descriptions.parse_standing) or descriptions.Standing()
    settings = program.ProgramSettings(
        spheres=tuple(given.spheres or ()),
        poses_per_sphere=given.poses,
        cap=np.radians(given.cap),
        approach=given.approach,
        pool=given.pool,
        bodies=bodies_of(given),
        standing=given.between_locations == program.GO,
        seed=given.seed,
    )
    found = program.Planner(arm, probe, gauge, settings).program(
        placements, given.locations or (), Progress(sys.stderr)
    )
    told = {name: value for name in MOTION if (value := getattr(given, name)) is not None}
    run = measuring.RunSettings(hold=standing.hold, **told)
    return run.timed(found, arm)


def described(given: argparse.Namespace) -> tuple[Arm, Probe, Gauge]:
    """Arm, probe and gauge of a command's arguments.

    Raises:
        DescriptionError: a file cannot be used.
    """
    return (
        configured('arm', given.arm, descriptions.parse_arm),
        configured('probe', given.probe, descriptions.parse_probe),
        configured('gauge', given.gauge, descriptions.parse_gauge),
    )


def bodies_of(given: argparse.Namespace) -> motion.BodySettings:
    """The sizes of `--bodies`.

    Raises:
        DescriptionError: the file cannot be used.
    """
    if not given.bodies:
        return motion.BodySettings()
    return descriptions.read_description(given.bodies, motion.parse_bodies)


def add_files(parser: CommandParser, names: Iterable[str]) -> None:
    """Options for description files, each with its default."""
    for name in names:
        file, what = FILES[name]
        text = f'{what} (default: {file} of calib_bringup)'
        parser.add_argument(f'--{name}', default='', metavar='FILE.yaml', help=text)


def add_probing(parser: CommandParser) -> None:
    """Options that say how spheres are probed."""
    default = program.ProgramSettings()
    parser.add_argument(
        '--spheres',
        type=int,
        nargs='+',
        metavar='N',
        help='to probe (default: four spread over the gauge, 1 6 10 14 of 15)',
    )
    parser.add_argument(
        '--cap',
        type=number_from(0, 180),
        default=70.0,
        metavar='DEG',
        help="around the gauge's z axis from which spheres are probed (default: %(default)s)",
    )
    parser.add_argument(
        '--approach',
        type=number_from(0, 1),
        default=default.approach,
        metavar='M',
        help="way along the probe's axis by which the arm comes and leaves (default: %(default)s); "
        '0: straight from contact to contact, whatever is between',
    )
    parser.add_argument(
        '--bodies',
        type=Path,
        metavar='FILE.yaml',
        help='sizes of arm, probe and gauge, and where the floor is',
    )
    parser.add_argument('--seed', type=whole_from(0, 2**62), default=default.seed, metavar='N')


def _add_motion(parser: CommandParser) -> None:
    """Options that say how fast the arm goes, as the capture's parameters of these names."""
    default = measuring.RunSettings()
    for name, (least, most, text) in MOTION.items():
        parser.add_argument(
            f'--{name.replace("_", "-")}',
            type=number_from(least, most),
            metavar='X',
            help=f'{text} (default: {getattr(default, name)})',
        )


def _parser() -> CommandParser:
    default = program.ProgramSettings()
    parser = CommandParser('plan', ABOUT, EXAMPLE)
    add_files(parser, FILES)
    parser.add_argument(
        '--locations', type=int, nargs='+', metavar='N', help='to visit (default: all)'
    )
    parser.add_argument(
        '--poses',
        type=whole_from(1, MOST_POSES),
        default=default.poses_per_sphere,
        metavar='N',
        help="postures around each sphere, of a tracker's target in all (default: %(default)s)",
    )
    parser.add_argument(
        '--pool',
        type=whole_from(1, MOST_POOL),
        default=default.pool,
        metavar='N',
        help='candidates for each pose, of which the most telling are taken (default: %(default)s; '
        '1: no choosing, planned in half the time)',
    )
    parser.add_argument(
        '--between-locations',
        choices=(program.WAIT, program.GO, program.SIMULATED),
        default=program.WAIT,
        help='go: a gauge stands at every location, and all are in the way; wait, simulated: there '
        'is one (default: %(default)s)',
    )
    add_probing(parser)
    _add_motion(parser)
    parser.add_argument(
        '--tracker',
        type=number_from(SMALLEST, 1),
        metavar='M',
        help='plan for a target that a tracker sees, no gauge and no probe; M: standard deviation '
        'of a coordinate, m',
    )
    parser.add_argument(
        '--target',
        type=number_from(-1, 1),
        nargs=3,
        action='append',
        metavar=('X', 'Y', 'Z'),
        help='m, where it is on the flange (default: 0 0 0.1); given again: another target, which '
        'is measured in every posture, too',
    )
    parser.add_argument(
        '--stations',
        type=whole_from(1, MOST_STATIONS),
        metavar='N',
        help='places that the tracker stands at, for its share of the postures each (default: 1)',
    )
    parser.add_argument(
        '--turn-noise',
        type=number_from(SMALLEST, 1),
        metavar='RAD',
        help='its orientation is measured, too, with this standard deviation about each axis',
    )
    parser.add_argument(
        '--output',
        type=Path,
        metavar='CSV',
        help='write its postures there, for import_points once x, y, z are added',
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
