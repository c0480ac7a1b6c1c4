# SPDX-License-Identifier: Apache-2.0
from typing import Any

def accumulate(
    inputs: tuple[Any, ...], outputs: tuple[Any, ...], first: int, last: int
) -> None: ...
