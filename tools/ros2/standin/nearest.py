# SPDX-License-Identifier: Apache-2.0
"""What a mistyped name may have been meant to be."""

from collections.abc import Iterable
from difflib import get_close_matches

MOST = 12


def nearest(name: str, known: Iterable[str]) -> str:
    """In words: the known names that are alike, else a few of all; empty where none is known."""
    names = sorted({other for other in known if '/_' not in other})  # the rest is hidden
    alike = get_close_matches(name, names, 3, 0.6)
    if alike:
        return f'; did you mean {" or ".join(alike)}?'
    if 0 < len(names) <= MOST:
        return f'; there is {", ".join(names)}'
    return ''
