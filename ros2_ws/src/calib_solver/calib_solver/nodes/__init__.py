# SPDX-License-Identifier: Apache-2.0
"""The solver as a ROS node."""
