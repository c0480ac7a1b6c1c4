# SPDX-License-Identifier: Apache-2.0
"""Speed and memory of the suite, as ratios; see README.md."""
