# SPDX-License-Identifier: Apache-2.0
"""The simulated arm, the capture and the replay as ROS nodes."""

import sys

from calib_model.starting import INTERRUPTED, begin, program

#: what ends by itself, and so is a command
ENDS = program().removesuffix('_node') in {'capture', 'check', 'replay'}
begin(__name__, INTERRUPTED if ENDS and 'serve:=true' not in sys.argv else 0)
