# SPDX-License-Identifier: Apache-2.0
"""What `ros2 run calib_capture` starts without a graph: arguments in, lines out."""

from calib_model.starting import begin

begin(__name__)
