# SPDX-License-Identifier: Apache-2.0
"""Topics of the running nodes."""
