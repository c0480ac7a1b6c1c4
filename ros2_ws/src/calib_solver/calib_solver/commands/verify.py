# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver verify`: a finished calibration on new poses, against limits or itself."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence

from calib_model.command_line import CommandParser, run_command
from calib_model.progress import Progress
from calib_solver import acceptance, calibration

ABOUT = """\
Judge a finished calibration by new poses, as few as 20 on spheres it was not made with: passed or
failed by limits; without limits, whether the errors are within what the calibration states of
itself. No pose is left out. Measured points (import_points) are judged by a calibration by such.

LIMITS.yaml holds lengths in m, as in `limits: {distance_max: 1.0e-4, two_sigma_max: 2.0e-4}`. Each
is a maximum of: distance_max, distance_mean, distance_rms, two_sigma_max, two_sigma_mean,
position_max, position_mean, position_rms; single_point_max, single_point_two_s_max, length_max,
length_two_rms as ASME B89.4.22 has them; location_error, length_error as ISO 10360-12 and
pose_accuracy, pose_repeatability, distance_accuracy, distance_repeatability as ISO 9283 has them.

Exit code 0; 1 when a limit is not kept; 2 when it cannot be judged."""
EXAMPLE = """\
example:
  ros2 run calib_solver verify bags/demo/held_out --result output/demo
  ros2 run calib_solver verify bags/monday --result output/mine --limits limits.yaml
"""


def arguments() -> CommandParser:
    """The command line of `verify`."""
    parser = CommandParser('verify', ABOUT, EXAMPLE)
    parser.add_argument('bag', nargs='+', metavar='BAG', help='bag folder or .mcap file')
    parser.add_argument(
        '--result', required=True, metavar='DIR', help='folder of `identify --output`'
    )
    parser.add_argument('--limits', default='', metavar='YAML', help='what must be kept, in m')
    parser.add_argument('--json', action='store_true', help='JSON on stdout, SI units')
    parser.add_argument('--output', default='', metavar='DIR', help='write verification.html there')
    calibration.add_gauge_arguments(parser)
    calibration.add_raw_arguments(parser)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0; 1 where a limit is not kept; or 2 and one line on stderr."""

    def work() -> int:
        given = arguments().parse_args(argv)
        sources = calibration.Sources(
            tuple(given.bag),
            gauge=given.gauge,
            raw=calibration.raw_settings(given),
            anew=given.raw,
            temperature=calibration.given_temperature(given),
        )
        found = acceptance.verify(sources, given.result, given.limits, Progress(sys.stderr, 'MB'))
        written = acceptance.write_verification(found, given.output) if given.output else None
        if given.json:
            print(json.dumps(found.record(), indent=1, allow_nan=False))
        else:
            print('\n'.join(acceptance.verification_lines(found)))
            if written is not None:
                print(f'wrote {written}')
        return 1 if found.verdict == acceptance.FAILED else 0

    return run_command(work)


if __name__ == '__main__':
    sys.exit(main())
