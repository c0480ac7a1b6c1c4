# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver evaluate`: the quality of a set of parameters on bags, as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from calib_model.command import CommandParser, run_command
from calib_model.correction import parse_correction
from calib_model.description import read_description
from calib_model.progress import Progress
from calib_solver.copies import copied_lines
from calib_solver.loading import Sources, load_all
from calib_solver.problem import Problem
from calib_solver.quality import assess
from calib_solver.raw_options import add_raw_arguments, raw_choice
from calib_solver.result import Record, quality_record, sphere_records

ABOUT = """\
Distance errors and 2 sigma of probing poses under given parameters; JSON on stdout, SI units."""
EXAMPLE = """example:
  ros2 run calib_solver evaluate bags/demo_test --arm output/demo/arm.yaml
"""


def arguments() -> CommandParser:
    """The command line of `evaluate`."""
    parser = CommandParser('evaluate', ABOUT, EXAMPLE)
    parser.add_argument('bag', nargs='+', metavar='BAG', help='bag folder or .mcap file')
    parser.add_argument('--arm', default='', metavar='YAML', help="this arm, not the bag's")
    parser.add_argument('--probe', default='', metavar='YAML', help="this probe, not the bag's")
    parser.add_argument(
        '--gauge', default='', metavar='YAML', help="this certificate, not the bag's"
    )
    parser.add_argument(
        '--correction', default='', metavar='YAML', help='with what identify found beyond D-H'
    )
    add_raw_arguments(parser)
    return parser


def evaluation_record(
    sources: Sources, correction: str = '', progress: Progress | None = None
) -> Record:
    """Q of the contract at the top level, and the probed spheres; `correction` is a file's path.

    `progress` hears how far reading is, and what was made of bags without poses.

    Raises:
        CalibrationError: a bag or a description cannot be used.
    """
    beyond = read_description(correction, parse_correction) if correction else None
    loaded = load_all(sources, progress)
    loaded = loaded.told_with(loaded.measured.arm, loaded.measured.probe, beyond)
    measured = loaded.measured
    if progress is not None:
        for line in (*copied_lines(loaded.copies), *loaded.lines):
            progress.say(line)
    quality = assess(Problem.of(measured), measured.arm, measured.probe, beyond)
    return {**quality_record(quality), 'spheres': sphere_records(quality.spheres)}


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""

    def work() -> None:
        given = arguments().parse_args(argv)
        sources = Sources(
            tuple(given.bag), given.arm, given.probe, given.gauge, raw=raw_choice(given),
            anew=given.raw,
        )  # fmt: skip
        # what is said goes beside the JSON
        record = evaluation_record(sources, given.correction, Progress(sys.stderr, 'MB'))
        print(json.dumps(record, indent=1, allow_nan=False))

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
