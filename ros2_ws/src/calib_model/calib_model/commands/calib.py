# SPDX-License-Identifier: Apache-2.0
"""`calib`: every command that needs no ROS graph, by its name alone."""

from __future__ import annotations

import ast
import sys
from collections.abc import Sequence
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from calib_model.command_line import CALIB, UsageError, run_command
from calib_model.files import shared_file

#: the packages in the order of the work, and what their commands are for
PURPOSES = {
    'calib_model': 'describe the arm',
    'calib_capture': 'plan, and gather poses',
    'selfcenter_probe': 'simulate',
    'calib_solver': 'identify, judge, and use it',
}
#: entry points: of the distribution without ROS, and of a workspace
GROUPS = ('calib.commands', 'console_scripts')
HELP = ('-h', '--help', 'help')


def commands() -> dict[str, metadata.EntryPoint]:
    """The commands by name: what setup.py of the packages lists that lies in `commands/`."""
    found: dict[str, metadata.EntryPoint] = {}
    for group in GROUPS:
        for entry in metadata.entry_points(group=group):
            package, _, rest = entry.value.partition('.')
            if package in PURPOSES and rest.startswith('commands.') and entry.name != CALIB:
                found.setdefault(entry.name, entry)
    return found


def overview() -> str:
    """What `calib --help` says: a line for each command, package by package."""
    known = commands()
    lines = ['usage: calib COMMAND ...', '', 'Calibrate a robot arm, without ROS.']
    for package, purpose in PURPOSES.items():
        lines += ['', f'to {purpose}:']
        for name, entry in sorted(known.items()):
            if entry.module.startswith(f'{package}.'):
                lines.append(f'  {name:16} {_what_for(entry.module)}')
    lines += ['', '`calib COMMAND --help` has the options and an example.']
    config = shared_file('calib_bringup', 'config')
    if config:
        lines.append(f'Arms, probes and gauges that are described: {config}')
    return '\n'.join(lines)


def _what_for(module: str) -> str:
    """The first sentence of the module's docstring, read without loading what it imports."""
    spec = find_spec(module)
    if spec is None or spec.origin is None:
        return ''
    text = ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding='utf-8'))) or ''
    told = ' '.join(text.partition('\n\n')[0].split())
    return told.partition('`: ')[2].rstrip('.') or told


def _run(argv: Sequence[str]) -> int:
    name, *words = argv or ['--help']
    if name in HELP:
        print(overview())
        return 0
    entry = commands().get(name)
    if entry is None:
        raise UsageError(f'calib: there is no command {name!r} (calib --help lists them)')
    if entry.module.startswith('calib_solver.') and not find_spec('calib_solver.problem._kernel'):
        print(
            'calib: installed without a C compiler: numpy calculates, more slowly',
            file=sys.stderr,
        )
    sys.argv = [f'{CALIB} {name}', *words]
    return int(entry.load()() or 0)


def main() -> int:
    """Entry point: the exit code of the command, or 2 and one line on stderr."""
    return run_command(lambda: _run(sys.argv[1:]))


if __name__ == '__main__':
    sys.exit(main())
