# SPDX-License-Identifier: Apache-2.0
"""Finds the verb that a command line names and runs it.

A command is a module of `verbs/` (`ros2 run`) or a package of it with one module per verb
(`ros2 service call`). A verb has a docstring, an EXAMPLE, `add_arguments(parser)` and `main(args)`,
which returns None or an exit code, and raises `Refusal` with the one line that is to be said.
"""

import argparse
import importlib
import io
import os
import pkgutil
import signal
import sys
from types import ModuleType

from . import verbs
from .nearest import nearest

ELSEWHERE = {
    'launch': 'launch files need a full ROS 2 install; `ros2 run calib_bringup demo` runs '
    'the demo, `ros2 pkg executables` lists the nodes'
}


class Interrupted(Exception):
    """A signal came while the graph was being used."""

    def __init__(self, number: int) -> None:
        super().__init__(signal.strsignal(number))
        self.number = number


class Refusal(Exception):
    """What was asked for cannot be done; the message is the one line that says why."""


def names_in(package: ModuleType) -> list[str]:
    return sorted(m.name for m in pkgutil.iter_modules(package.__path__))


def first_line(module: ModuleType) -> str:
    return (module.__doc__ or '').strip().split('\n')[0]


def overview(program: str, package: ModuleType, noun: str) -> str:
    lines = [f'usage: {program} [-h] <{noun}> ...', '', f'{noun}s:']
    for name in names_in(package):
        module = importlib.import_module(f'{package.__name__}.{name}')
        lines.append(f'  {name:<14}{first_line(module)}')
    lines += ['', f'  Call `{program} <{noun}> -h` for more detailed usage.']
    return '\n'.join(lines)


def choose(argv: list[str]) -> tuple[str, ModuleType, list[str]] | int:
    """The verb named by `argv` with its full name and arguments, or an exit code."""
    program, package, noun = 'ros2', verbs, 'command'
    while True:
        if not argv or argv[0] in ('-h', '--help'):
            print(overview(program, package, noun))
            return 0
        name, argv = argv[0], argv[1:]
        if name not in names_in(package):
            choices = ', '.join(names_in(package))
            there = ELSEWHERE.get(name, f'choose from {choices}{nearest(name, names_in(package))}')
            print(f"{program}: error: no {noun} '{name}' here: {there}", file=sys.stderr)
            return 2
        program = f'{program} {name}'
        module = importlib.import_module(f'{package.__name__}.{name}')
        if not hasattr(module, '__path__'):
            return program, module, argv
        package, noun = module, 'verb'


def main(argv: list[str]) -> int:
    chosen = choose(argv)
    if isinstance(chosen, int):
        return chosen
    program, verb, rest = chosen
    os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')  # messages check what is put into them
    parser = argparse.ArgumentParser(
        prog=program,
        description=first_line(verb),
        epilog=f'example:\n  {verb.EXAMPLE}',
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.add_arguments(parser)
    args = parser.parse_args(rest)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    return run(verb, args)


def run(verb: ModuleType, args: argparse.Namespace) -> int:
    """Exit code of the verb; interruptions count as the signal's number, as with ros2cli."""
    try:
        return int(verb.main(args) or 0)
    except Refusal as refusal:
        print(refusal, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return int(signal.SIGINT)
    except Interrupted as interrupted:
        return interrupted.number
    except BrokenPipeError:
        sys.stdout = None  # the reader has gone; nothing is left to be flushed to it
        return int(signal.SIGPIPE)
