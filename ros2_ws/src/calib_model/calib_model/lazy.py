# SPDX-License-Identifier: Apache-2.0
"""Names that a package or a room hands on, each loaded when it is first asked for (PEP 562)."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any


def lazily(
    package: str, file: str
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of the package whose `__init__.py` is `file`.

    What is handed on stands there once, as imports under `if TYPE_CHECKING:`, where type checkers
    and people read it too. A command that needs three names of a room loads three modules.
    """
    names = _listed(Path(file).read_text(encoding='utf-8'))

    def load(name: str) -> Any:
        module = names.get(name)
        if module is None:
            raise AttributeError(f'module {package!r} has no attribute {name!r}')
        value = getattr(import_module(module), name)
        setattr(sys.modules[package], name, value)
        return value

    return load, lambda: sorted(names), sorted(names)


def _listed(text: str) -> dict[str, str]:
    """The module of each name that is imported under `if TYPE_CHECKING:`, as ruff lays it out;
    Python's own parser would take ten times as long, for each room of a command."""
    shown = text.partition('if TYPE_CHECKING:\n')[2].partition('\nelse:')[0]
    return {
        name: module
        for module, names in re.findall(r'from (\S+) import \(([^)]*)\)', shown)
        for name in re.findall(r'\bas (\w+)', names)
    }
