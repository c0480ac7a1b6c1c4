# SPDX-License-Identifier: Apache-2.0
"""Message, service and action classes by the name that stands on the command line."""

import importlib
from typing import Any

from .command_line import Refusal


def interface(name: str, kind: str) -> Any:
    """Class of interface `pkg/kind/Name`, or `pkg/Name` for short.

    Raises:
        Refusal: there is no such interface, or it is of another kind.
    """
    parts = name.split('/')
    if len(parts) == 2:
        parts.insert(1, kind)
    label = {'msg': 'message', 'srv': 'service'}.get(kind, kind)
    if len(parts) != 3 or not all(parts):
        raise Refusal(f'The passed {label} type is invalid')
    if parts[1] != kind:
        raise Refusal(f'The passed type is not a {label}')
    try:
        return getattr(importlib.import_module(f'{parts[0]}.{kind}'), parts[2])
    except (ModuleNotFoundError, AttributeError):
        raise Refusal(f'The passed {label} type is invalid') from None
