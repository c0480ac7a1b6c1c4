# SPDX-License-Identifier: Apache-2.0
"""Configuration of arms, probes and gauges, launch files, and the demo."""

from calib_model.starting import begin

begin(__name__)
