# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver evaluate`: the quality of a set of parameters on bags, as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from calib_model.command_line import CommandParser, run_command
from calib_model.progress import Progress
from calib_solver import calibration

ABOUT = """\
Distance errors and 2 sigma of probing poses under given parameters, or how far measured points are
from where they are predicted; JSON on stdout, SI units."""
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
    calibration.add_raw_arguments(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""

    def work() -> None:
        given = arguments().parse_args(argv)
        sources = calibration.Sources(
            tuple(given.bag),
            given.arm,
            given.probe,
            given.gauge,
            raw=calibration.raw_settings(given),
            anew=given.raw,
        )
        # what is said goes beside the JSON
        record = calibration.evaluation_record(
            sources, given.correction, Progress(sys.stderr, 'MB')
        )
        print(json.dumps(record, indent=1, allow_nan=False))

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
