# SPDX-License-Identifier: Apache-2.0
"""The solver as a ROS node."""

from calib_model.starting import begin

begin(__name__, 0)
