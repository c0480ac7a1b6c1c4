# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture pair`: poses from the raw topics of a bag, as they were paired live."""

from __future__ import annotations

import sys
import tempfile
from dataclasses import fields, replace
from pathlib import Path

from calib_capture.repeat import Repeated, repeat_pairing
from calib_model.bag import write_measurement
from calib_model.bag_reader import read_note
from calib_model.command import CommandParser, run_command
from calib_model.description import read_description
from calib_model.errors import BagError
from calib_model.pairing import SteadySettings
from calib_model.pairing_note import NOTE, settings_of
from calib_model.placement import parse_placements

ABOUT = """\
Pair probe readings with joints anew from the raw topics of a bag, /joint_states and
/probe/displacements, with the settings it was captured with or others.

Which sphere a pose belongs to, its recorded pose on /capture/poses says. A bag without that topic
needs --placements: then it is the sphere whose nominal centre is near what the arm reports."""

EXAMPLE = """\
example:
  ros2 run calib_capture pair bags/demo/identification output/paired_again --dwell 0.02"""

TOLD = {
    'settle': 's that the arm must be still first',
    'dwell': 's of readings that are averaged',
    'max_speed': 'rad/s up to which the arm is still',
    'max_spread': 'm between readings of one pose',
    'max_gap': 's between joint states that are interpolated across',
    'lateness': 's that a message may be late',
}


def pair(
    raw: Path, out: Path, settings: SteadySettings, placements: Path | None = None,
    correct_clock: bool = False,
) -> Repeated:  # fmt: skip
    """Write the bag `out` of the poses paired anew from `raw`; whole or not at all.

    Raises:
        BagError: no usable bag at `raw`, nothing to pair, or `out` exists or cannot be written.
        DescriptionError: a description in the bag or the placements cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    if out.exists() or out.is_symlink():
        raise BagError(f'{out}: exists already, a bag is never overwritten')
    places = None if placements is None else read_description(placements, parse_placements)
    repeated = repeat_pairing(raw, settings, places, correct_clock)
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix='.pair-', dir=out.parent) as part:
            write_measurement(Path(part) / out.name, repeated.measured)
            (Path(part) / out.name).rename(out)
    except OSError as error:
        raise BagError(f'{out}: cannot be written: {error.strerror}') from error
    return repeated


def main() -> int:
    """The command."""
    return run_command(_pair)


def _pair() -> None:
    parser = CommandParser('pair', ABOUT, EXAMPLE)
    parser.add_argument('raw', metavar='RAW_BAG', type=Path, help="a bag's folder or .mcap file")
    parser.add_argument('out', metavar='OUT_BAG', type=Path, help='folder to make')
    parser.add_argument(
        '--placements', type=Path, metavar='P.yaml', help='where the gauge stood, by location'
    )
    parser.add_argument(
        '--correct-clock', action='store_true',
        help='pair readings with the joints by the estimated offset between their clocks',
    )  # fmt: skip
    for name, text in TOLD.items():
        parser.add_argument(
            f'--{name.replace("_", "-")}', type=float, metavar='X', help=f'{text}; as captured'
        )
    given = parser.parse_args()
    settings = settings_of(read_note(given.raw, NOTE))
    chosen = {
        each.name: getattr(given, each.name) for each in fields(settings)
        if getattr(given, each.name, None) is not None
    }  # fmt: skip
    repeated = pair(
        given.raw, given.out, replace(settings, **chosen), given.placements, given.correct_clock
    )
    if given.correct_clock and repeated.clock is None:
        print('no motion in contact: the offset between the clocks cannot be told')
    for line in repeated.lines():
        print(line)
    print(f'{given.out}: {len(repeated.measured.poses)} poses')


if __name__ == '__main__':
    sys.exit(main())
