# SPDX-License-Identifier: Apache-2.0
"""What the suite promises, shown on seeded simulations; each study writes results/NAME.txt."""
