# SPDX-License-Identifier: Apache-2.0
"""The simulated arm, the capture and the replay as ROS nodes."""

import sys

from calib_model.starting import INTERRUPTED, begin, program

#: what ends by itself, and so is a command
ENDS = program() in {'capture', 'capture_node', 'replay', 'replay_node'}
begin(__name__, INTERRUPTED if ENDS and 'serve:=true' not in sys.argv else 0)
