# SPDX-License-Identifier: Apache-2.0
"""One BLAS thread for small matrices: several only wait for one another, ten times as long."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from typing import ParamSpec

    P = ParamSpec('P')
R = TypeVar('R')

#: what tells BLAS how many threads to have, if it is set before numpy is loaded
VARIABLE = 'OPENBLAS_NUM_THREADS'


def ask_for_one_thread() -> None:
    """Set the environment so that BLAS comes with one thread, where it is not loaded yet."""
    if 'numpy' not in sys.modules:
        os.environ.setdefault(VARIABLE, '1')


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """The function with one BLAS thread while it runs, where the environment did not say how many
    there are: somebody else loaded numpy first."""

    @wraps(function)
    def run(*given: P.args, **named: P.kwargs) -> R:
        if VARIABLE in os.environ:
            return function(*given, **named)
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api='blas'):
            return function(*given, **named)

    return run
