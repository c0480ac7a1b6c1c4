# SPDX-License-Identifier: Apache-2.0
"""Identification of a probe's place on the flange (eq. 15) and of an arm's parameters (eq. 11)."""

import os

# the matrices are small: BLAS threads only wait for one another, and the compiled pass has its own
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
