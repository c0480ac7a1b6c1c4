# SPDX-License-Identifier: Apache-2.0
"""The chapter's tables and figures, and what else is promised, shown on seeded simulations; each
study writes results/NAME.txt."""

import os

# Before numpy is there: matrices of this size gain nothing from threads, and their waiting for one
# another costs several times the work itself where the seeds keep every core busy.
for _library in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS'):
    os.environ.setdefault(_library, '1')
