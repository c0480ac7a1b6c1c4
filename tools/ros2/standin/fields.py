# SPDX-License-Identifier: Apache-2.0
"""Messages filled from YAML, and written as YAML, as the ros2 commands do it."""

import array
import sys
from typing import Any

import numpy as np
import yaml
from rosidl_parser.definition import AbstractNestedType, NamespacedType

from .command_line import Refusal
from .interfaces import interface

TRUNCATE_LENGTH = 128


def parse(text: str) -> dict[str, Any]:
    """The YAML mapping that stands on the command line.

    Raises:
        Refusal: not YAML, or not a mapping.
    """
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        reason = ' '.join(str(error).split())
        raise Refusal(f'Failed to populate field: not YAML: {reason}') from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise Refusal(f"Failed to populate field: expected '{{name: value, ...}}', got {text!r}")
    return values


def fill(message: Any, values: dict[str, Any]) -> None:
    """Set the fields named in `values`, nested ones too.

    Raises:
        Refusal: a name that is not there or a value that does not fit.
    """
    slots = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
    for name, value in values.items():
        if name not in slots:
            raise Refusal(
                f"Failed to populate field: '{type(message).__name__}' object has no "
                f"attribute '{name}'"
            )
        try:
            setattr(message, name, converted(value, getattr(message, name), slots[name]))
        except (AssertionError, TypeError, ValueError) as error:
            reason = ' '.join(str(error).split())
            raise Refusal(f"Failed to populate field: '{name}': {reason}") from None


def converted(value: Any, current: Any, slot: Any) -> Any:
    """`value` as the field holding `current` takes it."""
    if isinstance(slot, AbstractNestedType):
        if isinstance(slot.value_type, NamespacedType):
            return [element(slot.value_type, item) for item in value]
        return np.array(value, current.dtype) if isinstance(current, np.ndarray) else list(value)
    if isinstance(slot, NamespacedType):
        return element(slot, value)
    # What YAML reads as a number may be meant as text, and 1 may be meant as 1.0.
    if isinstance(current, (str, float)) and not isinstance(value, type(current)):
        return type(current)(value)
    return value


def element(slot: Any, values: Any) -> Any:
    """A new message of the slot's type with `values` filled in."""
    if not isinstance(values, dict):
        raise TypeError(f"expected '{{name: value, ...}}', got {values!r}")
    message = interface('/'.join(slot.namespaced_name()), 'msg')()
    fill(message, values)
    return message


def plain(value: Any, truncate: int | None) -> Any:
    """`value` as YAML can write it; with `truncate`, long lists and texts end in '...'."""
    if hasattr(value, 'get_fields_and_field_types'):
        return {
            name: plain(getattr(value, name), truncate)
            for name in value.get_fields_and_field_types()
        }
    if isinstance(value, (str, bytes)):
        text = value if isinstance(value, str) else list(value)
        if truncate is not None and len(text) > truncate:
            return text[:truncate] + ('...' if isinstance(text, str) else ['...'])
        return text
    if isinstance(value, (np.ndarray, array.array)):
        value = value.tolist()
    if isinstance(value, (list, tuple, set)):
        items = list(value)
        kept = items if truncate is None else items[:truncate]
        return [plain(item, truncate) for item in kept] + ['...'] * (len(kept) < len(items))
    return value.item() if isinstance(value, np.generic) else value


def as_yaml(message: Any, truncate: int | None = None, flow: bool = False) -> str:
    text = yaml.safe_dump(
        plain(message, truncate),
        sort_keys=False,
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow,
    )
    return str(text)
