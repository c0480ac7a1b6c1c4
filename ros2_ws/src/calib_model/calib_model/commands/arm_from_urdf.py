# SPDX-License-Identifier: Apache-2.0
"""`ros2 run calib_model arm_from_urdf`: the D-H description of the arm in a URDF."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib_model import descriptions, files, kinematics, urdf
from calib_model.command_line import CommandParser, run_command
from calib_model.errors import CalibrationError, printable
from calib_model.instruments import Arm
from calib_model.transforms import RigidTransform

ABOUT = """\
Write the Denavit-Hartenberg description of a serial arm from its URDF.

The joints between the base link and the flange link have to be revolute, continuous, prismatic or
fixed; what hangs on them besides (grippers, cameras) is left alone. Joint positions, zeros and
limits are the URDF's. Axes that are parallel get Hayati's beta; where D-H cannot begin at the base
link or end at the flange link, base_T_dh and dh_T_flange say the rest."""
EXAMPLE = """\
example:
  ros2 run calib_model arm_from_urdf ur5.urdf --base base_link --flange tool0 ur5.yaml
"""


def summary(arm: Arm) -> str:
    """The parameters as a table for people (mm, deg), and what D-H could not take."""
    lines = [f'{arm.name}: {arm.n} joints from {arm.base_frame} to {arm.flange_frame} (mm, deg)']
    lines.append(f'{"":20}{"a":>10}{"alpha":>10}{"d":>10}{"theta_0":>10}{"beta":>10}')
    for joint in arm.joints:
        angles = np.degrees([joint.alpha, joint.theta_0, joint.beta])
        row = (1e3 * joint.a, angles[0], 1e3 * joint.d, angles[1], angles[2])
        lines.append(f'{joint.name:20.20}' + ''.join(f'{value:10.3f}' for value in row))
    for i in kinematics.parallel_joints(arm):
        lines.append(f'axes {i} and {i + 1} are parallel: beta{i} takes the place of d{i}')
    for key in ('base_T_dh', 'dh_T_flange'):
        if not getattr(arm, key).is_identity:
            lines.append(f'{key}: {_spelled(getattr(arm, key))}')
    return '\n'.join(lines)


def _spelled(transform: RigidTransform) -> str:
    mm = ', '.join(f'{1e3 * value:.3f}' for value in transform.translation)
    deg = ', '.join(f'{value:.3f}' for value in np.degrees(transform.rotation_vector))
    return f'({mm}) mm, rotation vector ({deg}) deg'


def run(argv: Sequence[str] | None = None) -> Arm:
    """Parse a command line, write the description.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    parser = CommandParser('arm_from_urdf', ABOUT, EXAMPLE)
    parser.add_argument('urdf', metavar='ROBOT.urdf')
    parser.add_argument('out', metavar='OUT.yaml', type=Path)
    parser.add_argument('--base', default='', metavar='LINK', help='default: the root link')
    parser.add_argument('--flange', default='', metavar='LINK', help='default: the only tip')
    parser.add_argument('--name', default='', help="default: the robot's name in the URDF")
    given = parser.parse_args(argv)
    arm = urdf.arm_from_urdf(
        urdf.read_urdf(given.urdf), given.base, given.flange, given.urdf, given.name
    )
    heading = f'# {arm.base_frame} to {arm.flange_frame} of {printable(Path(given.urdf).name)}\n'
    try:
        files.write_whole(given.out, heading + descriptions.arm_yaml(arm))
    except OSError as error:
        raise CalibrationError(f'{given.out}: cannot be written: {error.strerror}') from error
    return arm


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point: exit code 0, or 2 and one line on stderr."""
    return run_command(lambda: print(summary(run(argv))))


if __name__ == '__main__':
    sys.exit(main())
