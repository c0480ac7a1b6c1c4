# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_capture pair`: poses from the raw topics of a bag, as they were paired live."""

from __future__ import annotations

import sys
from argparse import Namespace
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import TypeVar

from calib_capture.recording import HandGuidedRecord
from calib_capture.replaying import (
    PairedHandGuided,
    PairedProgram,
    paired_hand_guided,
    paired_program,
)
from calib_model.bags import (
    TEMPERATURE_NOTE,
    read_notes,
    read_temperature,
    write_measurement,
)
from calib_model.bounds import PAIRING
from calib_model.command_line import CommandParser, UsageError, number_from, run_command
from calib_model.descriptions import parse_placements, read_description
from calib_model.files import made_whole, refuse_taken
from calib_model.measurement import Measurement
from calib_model.pairing import (
    HAND_GUIDED_NOTE,
    NOTE,
    HandGuidedSettings,
    SteadySettings,
    settings_of,
)
from calib_model.progress import Progress
from calib_model.stamps import TIMED_BY, TIMED_BY_TOLD

Settings = TypeVar('Settings', SteadySettings, HandGuidedSettings)

ABOUT = """\
Pair probe readings with joints anew from the raw topics of a bag, /joint_states and
/probe/displacements, with the settings it was captured with or others.

Which sphere a pose belongs to, its recorded pose on /capture/poses says. A bag without that topic
needs --placements: then it is the sphere whose nominal centre is near what the arm reports.

Of an arm that was led by hand (--mode continuous, or captured so) every reading is paired on the
move, and poses are taken along its way."""

EXAMPLE = """\
example:
  ros2 run calib_capture pair bags/demo/identification output/paired_again --dwell 0.02"""

MODES = ('program', 'continuous')
OF_LED = {
    'spacing': 'rad that the joints of a led arm go from pose to pose',
    'seated': 's at both ends of a contact of a led arm without a pose',
}
TOLD = {
    'settle': 's that the arm must be still first',
    'dwell': 's of readings that are averaged',
    'max_speed': 'rad/s up to which the arm is still',
    'max_spread': 'm between readings of one pose',
    'max_gap': 's between joint states that are interpolated across',
    'lateness': 's that a message may be late',
}


def pair(
    raw: Path,
    out: Path,
    settings: SteadySettings,
    placements: Path | None = None,
    correct_clock: bool = False,
    stamps: str = 'auto',
) -> PairedProgram:
    """Write the bag `out` of the poses paired anew from `raw`; whole or not at all.

    Raises:
        BagError: no usable bag at `raw`, nothing to pair, or `out` exists or cannot be written.
        DescriptionError: a description in the bag or the placements cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    refuse_taken(out)
    places = None if placements is None else read_description(placements, parse_placements)
    paired = paired_program(raw, settings, places, correct_clock, Progress(sys.stderr), stamps)
    _write(raw, out, paired.measured)
    return paired


def pair_hand_guided_bag(
    raw: Path, out: Path, note: HandGuidedRecord, correct_clock: bool = False, stamps: str = 'auto'
) -> PairedHandGuided:
    """Write the bag `out` of a led arm's poses paired anew from `raw`; whole or not at all.

    Raises:
        BagError: no usable bag at `raw`, nothing to pair, or `out` exists or cannot be written.
        DescriptionError: a description in the bag cannot be used.
        DataError: poses that do not fit the descriptions.
    """
    refuse_taken(out)
    paired = paired_hand_guided(raw, note, correct_clock, Progress(sys.stderr), stamps)
    _write(raw, out, paired.measured)
    return paired


def _write(raw: Path, out: Path, measured: Measurement) -> None:
    warm = read_temperature(raw)
    notes = {TEMPERATURE_NOTE: warm.content()} if warm is not None else {}
    with made_whole(out) as part:
        write_measurement(part, measured, Progress(sys.stderr), notes)


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
        '--correct-clock',
        action='store_true',
        help='pair readings with the joints by the estimated offset between their clocks',
    )
    parser.add_argument('--stamps', choices=TIMED_BY, default='auto', help=TIMED_BY_TOLD)
    parser.add_argument('--mode', choices=MODES, help='as captured')
    for name, text in (TOLD | OF_LED).items():
        parser.add_argument(
            f'--{name.replace("_", "-")}',
            type=number_from(*PAIRING[name]),
            metavar='X',
            help=f'{text}; as captured',
        )
    given = parser.parse_args()
    notes = read_notes(given.raw, (NOTE, HAND_GUIDED_NOTE))
    note = HandGuidedRecord.read(notes[HAND_GUIDED_NOTE], str(given.raw))
    led = given.mode == 'continuous' if given.mode else note is not None
    paired = _led(given, note) if led else _standing(given, notes[NOTE])
    if given.correct_clock and paired.clock is None:
        print('no motion in contact: the offset between the clocks cannot be told')
    for line in paired.lines():
        print(line)
    print(f'{given.out}: {len(paired.measured.poses)} poses')


def _standing(given: Namespace, note: Mapping[str, str]) -> PairedProgram:
    settings = _chosen(settings_of(note), given)
    return pair(given.raw, given.out, settings, given.placements, given.correct_clock, given.stamps)


def _led(given: Namespace, note: HandGuidedRecord | None) -> PairedHandGuided:
    if given.placements is not None:
        places = read_description(given.placements, parse_placements)
        settings = HandGuidedSettings() if note is None else note.settings
        note = HandGuidedRecord(settings, places, shift=0 if note is None else note.shift)
    if note is None:
        raise UsageError(
            f'{given.raw}: was not captured in mode continuous, '
            'say where the gauge stood (--placements)'
        )
    note = replace(note, settings=_chosen(note.settings, given))
    return pair_hand_guided_bag(given.raw, given.out, note, given.correct_clock, given.stamps)


def _chosen(settings: Settings, given: Namespace) -> Settings:
    """The settings as captured, but for those that are given."""
    chosen = {
        each.name: getattr(given, each.name)
        for each in fields(settings)
        if getattr(given, each.name, None) is not None
    }
    return replace(settings, **chosen)


if __name__ == '__main__':
    sys.exit(main())
