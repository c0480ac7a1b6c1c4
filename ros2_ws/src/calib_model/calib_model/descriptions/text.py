# SPDX-License-Identifier: Apache-2.0
"""What all descriptions share: read from a file, numbers written so that they come back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from calib_model.errors import DescriptionError
from calib_model.files import LARGEST_TEXT, Fields, file_content
from calib_model.transforms import RigidTransform

T = TypeVar('T')
TRANSFORM_KEYS = ('translation', 'rotation_vector')
LARGEST_BYTES = 4 * LARGEST_TEXT  # of a file, whatever the characters


def read_description(path: str | Path, parse: Callable[[str, str], T]) -> T:
    """The description in a file, by the parser of its kind.

    Raises:
        DescriptionError: the file cannot be read or its content cannot be used.
    """
    path = Path(path)
    try:
        text = file_content(path, LARGEST_BYTES).decode('utf-8')
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not a text file'
        raise DescriptionError(str(path), '', f'cannot be read: {reason}') from error
    return parse(text, str(path))


def transform_of(top: Fields, key: str) -> RigidTransform:
    """A rigid transform, m and rad; what is not there is zero."""
    row = top.mapping(key, TRANSFORM_KEYS)
    translation, turn = (row.numbers(name, 3, (0.0, 0.0, 0.0)) for name in TRANSFORM_KEYS)
    return RigidTransform(np.array(translation), np.array(turn))


def transform_row(transform: RigidTransform) -> dict[str, list[float]]:
    """The row of a rigid transform, as `transform_of` reads it."""
    return {key: getattr(transform, key).tolist() for key in TRANSFORM_KEYS}


def triple(values: tuple[float, ...]) -> tuple[float, float, float]:
    """Three numbers as a point or a direction."""
    x, y, z = values
    return (x, y, z)


class _Dumper(yaml.SafeDumper):
    """Numbers as YAML 1.1 reads them back: an exponent wants a point before it."""


def _float(dumper: yaml.SafeDumper, value: float) -> yaml.ScalarNode:
    return yaml.SafeDumper.represent_float(dumper, float(value))


_Dumper.add_multi_representer(float, _float)  # numpy floats are floats too


def yaml_text(value: dict[str, Any]) -> str:
    """YAML text that reads back bit for bit, keys in their order."""
    text: str = yaml.dump(
        value, Dumper=_Dumper, sort_keys=False, default_flow_style=None, width=100
    )
    return text
