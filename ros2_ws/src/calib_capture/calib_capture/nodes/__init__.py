# SPDX-License-Identifier: Apache-2.0
"""The simulated arm, the capture and the replay as ROS nodes."""
