# SPDX-License-Identifier: Apache-2.0
from typing import Any

def accumulate(
    inputs: tuple[Any, ...], outputs: tuple[Any, ...], first: int, last: int
) -> None: ...
def accumulate_points(
    inputs: tuple[Any, ...], outputs: tuple[Any, ...], first: int, last: int
) -> None: ...
