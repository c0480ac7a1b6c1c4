# SPDX-License-Identifier: Apache-2.0
"""Reading YAML mappings key by key, with errors that name the source, the place and what is due."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from unicodedata import category

from calib_model.errors import DescriptionError
from calib_model.files.safe_yaml import load_plain

MISSING: Any = object()


def load_mapping(text: str, source: str, keys: tuple[str, ...]) -> Fields:
    """The top-level mapping of a YAML text that may have `keys`.

    Raises:
        DescriptionError: not YAML, not a mapping, too large, a key that is there twice, it uses
            aliases or tags, it has a number that people read otherwise than YAML, or none of the
            keys: the file of something else.
    """
    found = Fields(load_plain(text, source, as_meant=True), source, '', keys)
    if found.content and not any(key in found for key in keys):
        some = ', '.join(map(str, list(found.content)[:3]))
        raise DescriptionError(source, '', f'expected {", ".join(keys)}, got {some}: another file?')
    return found


class Fields:
    """One mapping of a description, and where it stands in it."""

    def __init__(self, content: Any, source: str, where: str, keys: tuple[str, ...]) -> None:
        self.source = source
        self.where = where
        if not isinstance(content, Mapping):
            raise DescriptionError(source, where, f'expected a mapping, got {_kind(content)}')
        self.content = content
        for key in content:
            if key in keys:
                continue
            from difflib import get_close_matches

            # an unknown key is let pass (a comment, a newer field), a misspelt one is not
            close = get_close_matches(str(key), keys, n=1, cutoff=0.8)
            if close:
                raise DescriptionError(source, where, f'unknown key {key!r}: is it {close[0]!r}?')

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def refuse(self, key: str, problem: str) -> DescriptionError:
        """The error that says what is wrong with a key's value."""
        return DescriptionError(self.source, self._place(key), problem)

    def _place(self, key: str) -> str:
        return f'{self.where}.{key}' if self.where else key

    def _get(self, key: str, default: Any) -> Any:
        value = self.content.get(key, default)
        if value is MISSING:
            raise DescriptionError(self.source, self.where, f'missing key {key!r}')
        return value

    def text(self, key: str, default: str = MISSING) -> str:
        """A string that is not empty."""
        value = self._get(key, default)
        if not isinstance(value, str) or not value:
            raise self.refuse(key, f'expected a name, got {_kind(value)}')
        if any(category(sign) == 'Cc' for sign in value):  # names are printed, terminals obey these
            raise self.refuse(key, f'expected a name, got control characters: {value[:40]!a}')
        return value

    def number(self, key: str, default: float = MISSING, finite: bool = True) -> float:
        """A number; `finite` refuses infinities, NaN is always refused."""
        return self._number(key, self._get(key, default), finite)

    def _number(self, key: str, value: Any, finite: bool) -> float:
        if isinstance(value, str):
            # YAML 1.1 takes 1e-6 for a string; a user means the number
            try:
                value = float(value)
            except ValueError:
                raise self.refuse(key, f'expected a number, got {value[:40]!r}') from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, f'expected a number, got {_kind(value)}')
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if math.isnan(number) or (finite and math.isinf(number)):
            raise self.refuse(key, f'expected a finite number, got {number}')
        return number

    def numbers(
        self, key: str, count: int, default: tuple[float, ...] = MISSING, finite: bool = True
    ) -> tuple[float, ...]:
        """A list of `count` numbers."""
        value = self._get(key, default)
        if not isinstance(value, list | tuple) or len(value) != count:
            found = f'{len(value)}' if isinstance(value, list) else _kind(value)
            raise self.refuse(key, f'expected {count} numbers, got {found}')
        return tuple(self._number(f'{key}[{i}]', item, finite) for i, item in enumerate(value))

    def mapping(self, key: str, keys: tuple[str, ...]) -> Fields:
        """A mapping that may have `keys`."""
        return Fields(self._get(key, MISSING), self.source, self._place(key), keys)

    def rows(self, key: str, keys: tuple[str, ...]) -> list[Fields]:
        """A list, not empty, of mappings that may have `keys`; places count from 1."""
        value = self._get(key, MISSING)
        if not isinstance(value, list) or not value:
            raise self.refuse(key, f'expected a list that is not empty, got {_kind(value)}')
        return [
            Fields(row, self.source, f'{self._place(key)}[{i}]', keys)
            for i, row in enumerate(value, start=1)
        ]


def _kind(value: Any) -> str:
    names = {
        dict: 'a mapping',
        list: 'a list',
        str: 'text',
        bool: 'true/false',
        type(None): 'nothing',
    }
    return names.get(type(value), f'{value!r:.40}')
