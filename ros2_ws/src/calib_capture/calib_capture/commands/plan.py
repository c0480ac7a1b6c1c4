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
from calib_model import descriptions
from calib_model.command_line import CommandParser, number_from, run_command, whole_from
from calib_model.instruments import Arm, Gauge, Probe
from calib_model.progress import Progress

MOST_POSES, MOST_POOL = 100_000, 1000

ABOUT = """\
Plan the measuring program that `capture` with the same settings would run, and tell of it: how
many poses each sphere gets in which branch of the arm, which postures were refused and why, how
many ways between poses go around something, how long the capture will take with its other
parameters as they are by default, and how sure positions are to be expected after a calibration
with these poses.

Nothing may touch: arm, probe, the gauge where it stands, and the floor, which is the plane on
which the arm is mounted. How thick links are is assumed from the arm's reach; before a real arm
moves give --bodies, as config/bodies/kr5.yaml of calib_bringup, where `floor: -0.4` is one 0.4 m
lower and `floor: null` none."""

EXAMPLE = """\
example:
  ros2 run calib_capture plan --locations 1 2 --poses 20 --pool 5"""


def main() -> int:
    """The command."""
    return run_command(_plan)


def _plan() -> None:
    given = _parser().parse_args()
    for line in program.program_text(planned(given)):
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
    return measuring.RunSettings(hold=standing.hold).timed(found, arm)


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
        help='postures around each sphere (default: %(default)s)',
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
    return parser


if __name__ == '__main__':
    sys.exit(main())
