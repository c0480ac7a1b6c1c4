# SPDX-License-Identifier: Apache-2.0
"""The capture node in its parts: the graph's side, a run from waiting to closed bag, services."""
