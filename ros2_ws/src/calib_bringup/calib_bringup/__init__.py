# SPDX-License-Identifier: Apache-2.0
"""Configuration of arms, probes and gauges, launch files, and the demo."""
