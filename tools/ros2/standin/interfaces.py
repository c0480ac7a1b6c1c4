# SPDX-License-Identifier: Apache-2.0
"""Message, service and action classes by the name that stands on the command line."""

import importlib
from pathlib import Path
from typing import Any

from ament_index_python import get_resource, get_resources

from .command_line import Refusal
from .nearest import nearest


def interface(name: str, kind: str) -> Any:
    """Class of interface `pkg/kind/Name`, or `pkg/Name` for short.

    Raises:
        Refusal: there is no such interface, or it is of another kind.
    """
    parts = full_name(name, kind).split('/')
    label = {'msg': 'message', 'srv': 'service'}.get(kind, kind)
    if len(parts) != 3 or not all(parts):
        raise Refusal(f'The passed {label} type is invalid')
    if parts[1] != kind:
        raise Refusal(f'The passed type is not a {label}')
    try:
        return getattr(importlib.import_module(f'{parts[0]}.{kind}'), parts[2])
    except (ModuleNotFoundError, AttributeError):
        there = nearest(name, installed(parts[0], kind))
        raise Refusal(f'The passed {label} type is invalid{there}') from None


def full_name(name: str, kind: str) -> str:
    parts = name.split('/')
    return '/'.join((parts[0], kind, parts[1])) if len(parts) == 2 else name


def installed(package: str, kind: str) -> list[str]:
    """Names of a package's interfaces of a kind; where there is no such package, of all of them."""
    known = get_resources('rosidl_interfaces')
    return [
        f'{name}/{kind}/{Path(line).stem}'
        for name in ([package] if package in known else known)
        for line in get_resource('rosidl_interfaces', name)[0].splitlines()
        if line.startswith(f'{kind}/') and line.endswith(f'.{kind}')
    ]
