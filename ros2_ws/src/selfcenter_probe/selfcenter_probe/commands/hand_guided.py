# SPDX-License-Identifier: Apache-2.0
"""`ros2 run selfcenter_probe hand_guided`: a hand-guided measuring arm makes a bag."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from calib_model import bags, files
from calib_model.command_line import CommandParser, UsageError, run_command
from calib_model.measurement import Measurement, group_by_sphere
from calib_model.progress import Progress
from selfcenter_probe import operator

ABOUT = """\
Let a simulated operator lead a measuring arm by hand around the spheres of a ball bar, as the
chapter does with its FARO Sterling, and put the poses into a bag.

The probe is passive (a seat that is pressed on the sphere, and bends gauge and arm) or active
(styli that only their springs press). The same seed is the same arm, gauge and hand, whatever
probe and locations are asked for. Spheres out of reach are told and left out; their poses are
taken at the others."""
EXAMPLE = """\
example, the chapter's 10,780 poses and the location it tests them on:
  ros2 run selfcenter_probe hand_guided output/faro --probe passive
  ros2 run selfcenter_probe hand_guided output/faro_test --probe passive --locations 8 \\
    --spheres 1 2 3 4 5 6 7 8 9 10 11 12 13 14 --poses 429
  ros2 run calib_solver identify output/faro --test output/faro_test --output output/faro_result"""


def arguments() -> CommandParser:
    """The command line of `hand_guided`."""
    parser = CommandParser('hand_guided', ABOUT, EXAMPLE)
    parser.add_argument('out', metavar='OUT_BAG', type=Path, help='folder to make')
    parser.add_argument(
        '--probe',
        metavar='KIND',
        default='passive',
        help='passive, active, or a YAML file with its description (default: %(default)s)',
    )
    parser.add_argument(
        '--locations',
        metavar='N',
        type=int,
        nargs='+',
        default=list(range(1, 8)),
        help='of the gauge, by number (default: 1 to 7)',
    )
    parser.add_argument(
        '--spheres',
        metavar='N',
        type=int,
        nargs='+',
        default=[1, 6, 10, 14],
        help='of the gauge, by number (default: 1 6 10 14)',
    )
    parser.add_argument(
        '--poses', metavar='N', type=int, default=385, help='per sphere (default: %(default)s)'
    )
    parser.add_argument(
        '--speed',
        metavar='RAD/S',
        type=float,
        default=1.0,
        help='of all joints together (default: %(default)s)',
    )
    parser.add_argument(
        '--seed', metavar='N', type=int, default=1, help='of arm, gauge and hand (default: 1)'
    )
    parser.add_argument(
        '--raw',
        action='store_true',
        help='put joint states at 250 Hz and probe readings at 500 Hz into the bag, too',
    )
    for name, (_, file, meaning) in operator.FILES.items():
        parser.add_argument(
            f'--{name}', metavar='YAML', type=Path, help=f'{meaning} (default: {Path(file).name})'
        )
    return parser


def checked(given: Namespace, scene: operator.Scene) -> operator.MotionSettings:
    """What the operator is asked for.

    Raises:
        UsageError: names the argument that makes no sense in this scene.
    """
    for name, known in (('locations', scene.placements), ('spheres', scene.gauge.numbers)):
        asked = getattr(given, name)
        unknown = [number for number in asked if number not in known]
        if unknown:
            there = ', '.join(map(str, sorted(known)))
            raise UsageError(f'--{name}: there is no {unknown[0]} (there are {there})')
        if len(set(asked)) < len(asked):
            raise UsageError(f'--{name}: a number is there twice')
    if not 2 <= given.poses <= 100_000:
        raise UsageError(f'--poses: expected 2 to 100000 per sphere, got {given.poses}')
    if not 0.01 <= given.speed <= 10:
        raise UsageError(f'--speed: expected 0.01 to 10 rad/s, got {given.speed}')
    if given.seed < 0:
        raise UsageError(f'--seed: expected no negative number, got {given.seed}')
    return operator.MotionSettings(given.poses, given.speed, given.seed)


class _Told:
    """Progress of one part of the work after the other."""

    def __init__(self, things: str) -> None:
        self._progress = Progress(sys.stdout, things)
        self._begin = time.monotonic()

    def __call__(self, done: int, planned: int, where: str) -> None:
        now = time.monotonic()
        left = (now - self._begin) / done * (planned - done) if done else float('nan')
        self._progress.show(done, planned, left, where, now)

    def end(self) -> None:
        self._progress.clear()


def measure(
    scene: operator.Scene, motion: operator.HandMotion, hand: operator.HandGuided
) -> Measurement:
    """All poses of a motion, with progress.

    Raises:
        DataError: the arm cannot hold a sphere all along.
    """
    told = _Told('poses')
    taken, done = [], 0
    for number, seating in enumerate(motion.seatings):
        told(done, motion.poses, f'location {seating.location} sphere {seating.sphere}')
        taken.append((seating, hand.poses_of(number)))
        done += seating.poses
    told.end()
    probe = replace(scene.probe, simulated=True)
    return Measurement(scene.arm, probe, scene.gauge, operator.probing_set(taken), 'hand').checked()


def write(out: Path, measured: Measurement, hand: operator.HandGuided | None) -> None:
    """The bag, whole or not at all; with a `hand` its raw streams are in it, too.

    Raises:
        BagError: there is something at `out` already, or it cannot be written.
    """
    with files.made_whole(out) as part:
        if hand is None:
            bags.write_measurement(part, measured)
        else:
            told = _Told('seatings')
            operator.write_raw(part, measured, hand, told)
            told.end()


def main() -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""
    return run_command(run)


def run(argv: Sequence[str] | None = None) -> None:
    """Parse a command line and make the bag.

    Raises:
        CalibrationError: anything that keeps it from being done.
    """
    given = arguments().parse_args(argv)
    files.refuse_taken(given.out)
    scene = operator.read_scene(
        given.probe, {name: getattr(given, name) for name in operator.FILES}
    )
    settings = checked(given, scene)
    world = scene.world(given.seed)
    told = _Told('spheres')
    sides = {number: scene.placements[number] for number in given.locations}
    motion = operator.guided(world, sides, given.spheres, settings, told)
    told.end()
    for location, sphere in motion.absent:
        print(f'location {location}: sphere {sphere} is out of reach and left out')
    hand = operator.HandGuided(world, motion, given.seed)
    measured = measure(scene, motion, hand)
    write(given.out, measured, hand if given.raw else None)
    _report(given.out, measured, motion)


def _report(out: Path, measured: Measurement, motion: operator.HandMotion) -> None:
    poses = measured.poses
    spheres, _ = group_by_sphere(poses.location, poses.sphere)
    seconds = (motion.seatings[-1].end - motion.seatings[0].begin) / 1e9
    print(
        f'{out}: {len(poses)} poses of {measured.arm.name} with {measured.probe.name}, '
        f'{len(spheres)} spheres at {len(set(spheres[:, 0].tolist()))} locations, '
        f'{len(motion.seatings)} seatings in {seconds / 60:.0f} min'
    )


if __name__ == '__main__':
    sys.exit(main())
