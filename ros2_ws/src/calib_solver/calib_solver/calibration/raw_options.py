# SPDX-License-Identifier: Apache-2.0
"""What a command line says of bags that hold raw topics only."""

from __future__ import annotations

from argparse import Namespace

from calib_model import labelling
from calib_model.bounds import PAIRING
from calib_model.command_line import CommandParser, UsageError, number_from
from calib_model.stamps import TIMED_BY, TIMED_BY_TOLD
from calib_model.topics import JOINT_STATES, PROBE_DISPLACEMENTS, RawTopics

MOTIONS = {'auto': None, 'standing': True, 'led': False}
SETTINGS = {
    'settle': 's that the arm must be still first',
    'dwell': 's of readings that are averaged',
    'max_speed': 'rad/s up to which the arm is still',
    'max_spread': 'm between readings of one pose',
}


def add_raw_arguments(parser: CommandParser) -> None:
    """The options of bags without poses, in a group of their own."""
    group = parser.add_argument_group(
        'bags with nothing but the raw topics',
        'are paired first, and their spheres and locations told apart by the certificate.',
    )
    group.add_argument(
        '--joint-states', default=JOINT_STATES.name, metavar='TOPIC', help='default: %(default)s'
    )
    group.add_argument(
        '--displacements',
        default=PROBE_DISPLACEMENTS.name,
        metavar='TOPIC',
        help='default: %(default)s',
    )
    group.add_argument(
        '--joints',
        nargs='+',
        default=[],
        metavar='NAME',
        help="the arm's joints by their names in the bag, base first (default: the description's)",
    )
    group.add_argument(
        '--spheres',
        nargs='+',
        type=int,
        default=[],
        metavar='N',
        help='numbers of the spheres that were probed (default: told from their distances)',
    )
    group.add_argument(
        '--motion',
        default='auto',
        metavar='HOW',
        help='standing: the arm stopped for each pose; led: it was led around the spheres in '
        'contact; auto (default): the data tell',
    )
    group.add_argument(
        '--stamps',
        default='auto',
        metavar='HOW',
        help=TIMED_BY_TOLD,
    )
    for name, text in SETTINGS.items():
        group.add_argument(
            f'--{name.replace("_", "-")}',
            type=number_from(*PAIRING[name]),
            metavar='X',
            help=f'{text} (as captured)',
        )
    group.add_argument(
        '--raw', action='store_true', help='take bags for raw ones that have poses, too'
    )


def raw_settings(given: Namespace) -> labelling.RawSettings:
    """What was chosen.

    Raises:
        UsageError: a value that an option does not take.
    """
    if given.motion not in MOTIONS:
        raise UsageError(f'--motion: expected one of {", ".join(MOTIONS)}, got {given.motion!r}')
    if given.stamps not in TIMED_BY:
        raise UsageError(f'--stamps: expected one of {", ".join(TIMED_BY)}, got {given.stamps!r}')
    chosen = {name: getattr(given, name) for name in SETTINGS if getattr(given, name) is not None}
    if len(set(given.spheres)) < len(given.spheres):
        raise UsageError('--spheres: a number is there twice')
    topics = RawTopics(given.joint_states, given.displacements, tuple(given.joints))
    settings = tuple(chosen.items())
    return labelling.RawSettings(
        topics, tuple(given.spheres), settings, MOTIONS[given.motion], given.stamps
    )
