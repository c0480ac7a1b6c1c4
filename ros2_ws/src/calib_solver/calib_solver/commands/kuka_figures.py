# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver kuka_figures`: a calibration in the controller's own figures."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace

from calib_model import descriptions
from calib_model.command_line import CommandParser, run_command
from calib_solver import compensation

ABOUT = """\
Print what a calibration means in the controller's own figures: by how many degrees each axis really
stands further on than it shows, in the axis' own direction, and the tool frame X Y Z (mm), A B C
(deg: about Z, then the new Y, then the new X) of the probe.

RESULT is the folder of `identify --output`. How the controller counts each axis, and where its
flange frame is, the arm description says with `controller` and `flange_T_controller`; each line
says what was taken. Signs are not guessed: without `controller` there are no figures, unless
--assume-urdf takes the joints' own directions, and says so on every line."""
EXAMPLE = """\
example:
  ros2 run calib_solver kuka_figures output/mine
"""


def run(argv: Sequence[str] | None = None) -> compensation.ControllerFigures:
    """Parse a command line and find the figures.

    Raises:
        CalibrationError: the folder is not what `identify` writes.
    """
    parser = CommandParser('kuka_figures', ABOUT, EXAMPLE)
    parser.add_argument('result', metavar='RESULT')
    parser.add_argument(
        '--arm',
        default='',
        metavar='YAML',
        help="take the controller's side from this description, not the result's",
    )
    parser.add_argument(
        '--assume-urdf',
        action='store_true',
        help="without `controller`, take each axis to count as the URDF's joint does",
    )
    given = parser.parse_args(argv)
    calibrated = compensation.read_calibrated(given.result)
    if given.arm:
        described = descriptions.read_description(given.arm, descriptions.parse_arm)
        calibrated = replace(
            calibrated, identified=compensation.counted_as(calibrated.identified, described)
        )
    return compensation.controller_figures(calibrated, given.assume_urdf)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""
    return run_command(lambda: print(compensation.figures_text(run(argv))))


if __name__ == '__main__':
    sys.exit(main())
