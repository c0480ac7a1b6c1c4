# SPDX-License-Identifier: Apache-2.0
"""What every test of every package needs."""

import os
import signal
from collections.abc import Iterator

# before numpy is loaded: tests go side by side, and their matrices are small
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import pytest
from hypothesis import settings

from calib_bringup.domains import claimed_domain

# A shell that starts pytest in the background makes it ignore Ctrl-C, and so would every process
# that a test starts and then interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes tells what else the machine does; pytest-timeout ends what hangs.
settings.register_profile('calibration', deadline=None)
settings.load_profile('calibration')


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain id that no graph of this machine is on, and no other test will take."""
    with claimed_domain() as number:
        yield number
