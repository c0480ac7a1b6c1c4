# SPDX-License-Identifier: Apache-2.0
"""Put what every command and node says of itself by --help into docs/interfaces.md.

    python tools/document_interfaces.py

A test holds the document to it.
"""

from __future__ import annotations

import importlib
import io
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import metadata
from pathlib import Path
from unittest import mock

DOCUMENT = Path(__file__).resolve().parent.parent / 'docs' / 'interfaces.md'
BEGIN, END = '<!-- begin: --help -->\n', '<!-- end: --help -->\n'
PACKAGES = ('calib_model', 'selfcenter_probe', 'calib_capture', 'calib_solver', 'calib_bringup')
WIDTH = '100'


def commands() -> list[tuple[str, str, str]]:
    """Package, name and module of every command and node."""
    found = []
    for entry in metadata.entry_points(group='console_scripts'):
        package = entry.value.partition('.')[0]
        if package in PACKAGES:
            found.append((package, entry.name, entry.value.partition(':')[0]))
    return sorted(found, key=lambda each: (PACKAGES.index(each[0]), each[1]))


def help_of(name: str, module: str) -> str:
    """What the command prints on --help.

    Raises:
        SystemExit: with another code than 0.
    """
    loaded, said = importlib.import_module(module), io.StringIO()
    words = [name, '--help']
    try:
        with redirect_stdout(said), mock.patch.dict(os.environ, COLUMNS=WIDTH):
            if hasattr(loaded, 'COMMAND'):  # a node: its main would take over the signals
                loaded.COMMAND.parse(words)
            else:
                with mock.patch.object(sys, 'argv', words):
                    loaded.main()
    except SystemExit as end:
        if end.code:
            raise
    return said.getvalue()


def without_this_machine(text: str) -> str:
    """The same with the folders that are defaults here named instead of told."""
    for path, name in (
        (os.getcwd(), 'the working folder'),
        (tempfile.gettempdir(), 'the temporary folder'),
        (str(Path.home()), "the user's home"),
    ):
        text = text.replace(f"'{path}'", name)
    return re.sub(r'\A(usage: .*?)\n\n', '', text, flags=re.DOTALL)  # wrapped by Python's version


def sections() -> Iterator[str]:
    """A heading and a block for each command."""
    for package, name, module in commands():
        text = without_this_machine(help_of(name, module)).rstrip()
        yield f'### ros2 run {package} {name}\n```text\n{text}\n```\n'


def main() -> None:
    """Rewrite the document's part."""
    before, _, rest = DOCUMENT.read_text(encoding='utf-8').partition(BEGIN)
    _, _, after = rest.partition(END)
    text = before + BEGIN + '\n'.join(sections()) + END + after
    DOCUMENT.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
