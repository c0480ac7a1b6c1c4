# SPDX-License-Identifier: Apache-2.0
"""The probe and the operator of a measuring arm as ROS nodes."""

from calib_model.starting import begin

begin(__name__, 0)
