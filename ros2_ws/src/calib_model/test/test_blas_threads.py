# SPDX-License-Identifier: Apache-2.0
"""One BLAS thread for small matrices, whoever loaded numpy first."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.timeout(60)
PROGRAM = """
{first}
from threadpoolctl import threadpool_info
from calib_model.blas_threads import one_blas_thread
import calib_solver
import numpy

def blas():
    return [one['num_threads'] for one in threadpool_info() if one['user_api'] == 'blas']

print(one_blas_thread(blas)(), blas())
"""


def told(first, **environment):
    """What BLAS has within and behind the function, in a process of its own."""
    clean = {name: value for name, value in os.environ.items() if 'NUM_THREADS' not in name}
    program = PROGRAM.format(first=first)
    done = subprocess.run(
        [sys.executable, '-c', program],
        env=clean | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=50,
    )
    return done.stdout.strip()


def test_a_notebook_that_loaded_numpy_keeps_its_threads_but_for_the_calculation() -> None:
    pytest.importorskip('threadpoolctl')
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip('a single core')
    within, behind = told('import numpy').split('] [')
    assert within == '[1'
    assert int(behind.rstrip(']')) > 1


def test_numpy_loaded_by_the_suite_has_one_and_who_asked_for_more_has_them() -> None:
    assert told('') == '[1] [1]'
    if len(os.sched_getaffinity(0)) > 1:
        assert told('import numpy', OPENBLAS_NUM_THREADS='2') == '[2] [2]'
