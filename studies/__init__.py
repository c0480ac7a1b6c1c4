# SPDX-License-Identifier: Apache-2.0
"""The chapter's tables and figures, and what else is promised, shown on seeded simulations; each
study writes results/NAME.txt."""
