# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_solver ur_kinematics`: a calibration for Universal Robots' ROS driver."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from calib_model import files
from calib_model.command_line import CommandParser, run_command
from calib_model.errors import CalibrationError
from calib_solver import compensation

ABOUT = """\
Write the identified arm in the form that Universal Robots' ROS driver and ur_description take as
kinematics_params_file: shoulder, upper_arm, forearm and wrist_1 to wrist_3, each with x, y, z (m),
roll, pitch and yaw (rad). The numbers written are held against the identified arm to 1e-9 m.

RESULT is the folder of `identify --output`. Joint positions are the driver's, and the arm's base
frame is base_link, base or base_link_inertia. Where that frame stands and how the last joint counts
no probing tells: these are as in the arm description. What was identified beyond the D-H parameters
(joint errors, eq. 12) has no place in this form."""
EXAMPLE = """\
example:
  ros2 run calib_solver ur_kinematics output/mine my_ur_kinematics.yaml
  ros2 launch ur_robot_driver ur_control.launch.py ur_type:=ur5 robot_ip:=192.168.56.101 \\
    kinematics_params_file:=$PWD/my_ur_kinematics.yaml
"""


def run(argv: Sequence[str] | None = None) -> list[str]:
    """Parse a command line, write the file, and say what there is to say.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    parser = CommandParser('ur_kinematics', ABOUT, EXAMPLE)
    parser.add_argument('result', metavar='RESULT')
    parser.add_argument('out', metavar='OUT.yaml', type=Path)
    parser.add_argument(
        '--hash',
        default='',
        metavar='CHECKSUM',
        help="the robot's own, as in the file that ur_calibration extracts: the driver compares it "
        'with the robot (default: one of these numbers, which the driver says is not the '
        "robot's)",
    )
    given = parser.parse_args(argv)
    calibrated = compensation.read_calibrated(given.result)
    text = compensation.driver_yaml(calibrated.identified, given.hash)
    try:
        files.write_whole(given.out, text)
    except OSError as error:
        raise CalibrationError(f'{given.out}: cannot be written: {error.strerror}') from error
    lines = [f'wrote {given.out}']
    if calibrated.correction is not None:
        lines.insert(0, 'not in it: correction.yaml (joint errors, eq. 12), use compensate for it')
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""
    return run_command(lambda: print('\n'.join(run(argv))))


if __name__ == '__main__':
    sys.exit(main())
