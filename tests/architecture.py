# SPDX-License-Identifier: Apache-2.0
"""Who imports whom in the packages, and what of it goes against docs/architecture.md.

Everything is judged on a mapping of modules to their source, so that a test can add a line to one.
A room is a folder of a package, or a module that lies in no folder.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

SOURCES = Path(__file__).resolve().parents[1] / 'ros2_ws' / 'src'

#: what each package may import of the others
BELOW = {
    'calib_interfaces': set(),
    'calib_model': {'calib_interfaces'},
    'selfcenter_probe': {'calib_interfaces', 'calib_model'},
    'calib_capture': {'calib_interfaces', 'calib_model'},
    'calib_solver': {'calib_interfaces', 'calib_model'},
    'calib_bringup': {
        'calib_interfaces',
        'calib_model',
        'selfcenter_probe',
        'calib_capture',
        'calib_solver',
    },
}
#: the rooms of each package: a room imports only what stands after it
ORDER = {
    'calib_model': 'nodes commands labelling tracking pairing streams bags urdf descriptions '
    'kinematics measurement measured_points instruments files topics progress command_line bounds '
    'stamps transforms arrays errors lazy blas_threads starting',
    'selfcenter_probe': 'nodes commands operator simulation sensing',
    'calib_capture': 'nodes commands replaying showing recording measuring program motion checking '
    'default_files',
    'calib_solver': 'nodes commands serving acceptance calibration report results resampling '
    'held_out points identification identified preparation left_out faults error_models '
    'compensation fitting quality problem',
    'calib_bringup': 'demo launching showing variants processes domains',
}
#: loose modules that every room may use; drawn, they would hide the rest
BASE = {
    'topics',
    'progress',
    'command_line',
    'bounds',
    'stamps',
    'transforms',
    'arrays',
    'errors',
    'lazy',
    'blas_threads',
    'starting',
    'typed_lines',
}
#: a room's modules that others use under the module's name, as `cdr.decode`
HANDED_ON_WHOLE = {'calib_model.bags.cdr'}
ROS = re.compile(r'rclpy|\w+_(msgs|srvs|interfaces)')

Sources = Mapping[str, str]


def sources() -> dict[str, str]:
    """The source of every module, `pkg.room.file`; of a folder's own file, `pkg.room.__init__`."""
    return {
        '.'.join(path.relative_to(SOURCES / package).with_suffix('').parts): path.read_text()
        for package in ORDER
        for path in sorted((SOURCES / package / package).rglob('*.py'))
    }


@dataclass(frozen=True)
class Import:
    """`importer` says `from target import name`, or `import target` where there is no name."""

    importer: str
    target: str
    name: str = ''
    alias: str = ''

    def __str__(self) -> str:
        asked = f'from {self.target} import {self.name}' if self.name else f'import {self.target}'
        return f'{self.importer}: {asked}'


def imports(code: Sources) -> list[Import]:
    """All imports of all modules, wherever in the module; folders' own files only hand on.

    A room taken as a whole, `from calib_model import bags`, is an import of each name that is used
    of it, `bags.recover`: that loads it later, and no more of the room.
    """
    return [
        each
        for module, text in code.items()
        if not module.endswith('.__init__')
        for found in _imports_of(module, text)
        for each in _names_used(code, found)
    ]


def _names_used(code: Sources, found: Import) -> list[Import]:
    taken = f'{found.target}.{found.name}'
    if '.' in found.target or f'{taken}.__init__' not in code:
        return [found]
    names = _attributes(code[found.importer]).get(found.alias or found.name, set())
    return [Import(found.importer, taken, name) for name in sorted(names)]


@cache
def _attributes(text: str) -> dict[str, set[str]]:
    """Which attributes are asked of which names."""
    asked: dict[str, set[str]] = {}
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            asked.setdefault(node.value.id, set()).add(node.attr)
    return asked


@cache
def _imports_of(module: str, text: str) -> list[Import]:
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            found += [Import(module, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            target = '.' * node.level + (node.module or '')
            found += [Import(module, target, a.name, a.asname or '') for a in node.names]
    return found


def handed_on(code: Sources, folder: str) -> dict[str, str]:
    """The names that a folder hands on, and the module or room that each comes from."""
    return _handed_on(code.get(f'{folder}.__init__', ''))


@cache
def _handed_on(text: str) -> dict[str, str]:
    return {
        alias.name: node.module
        for block in ast.parse(text).body
        if isinstance(block, ast.If)
        for node in block.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }


def room(module: str) -> tuple[str, str]:
    """Package and room of a module; the room is '' where a package itself is named."""
    package, _, rest = module.partition('.')
    return package, rest.split('.')[0]


def ours(code: Sources) -> Iterator[Import]:
    """Those imports that are of our own packages."""
    return (one for one in imports(code) if room(one.target)[0] in BELOW)


def between_rooms(code: Sources) -> Iterator[tuple[Import, tuple[str, str], tuple[str, str]]]:
    """Imports from one room to another, with the rooms at both ends."""
    for one in ours(code):
        _, target = source_of(code, one)
        here, there = room(one.importer), room(target)
        if here != there and there[0] != 'calib_interfaces':
            yield one, here, there


def source_of(code: Sources, one: Import) -> tuple[bool, str]:
    """Whether the import is by a door's handed-on name, and the module that has what it names."""
    target, by_door = one.target, False
    if f'{target}.{one.name}' in code or f'{target}.{one.name}.__init__' in code:
        target = f'{target}.{one.name}'
        return target in HANDED_ON_WHOLE, target
    while one.name in handed_on(code, target):
        target, by_door = handed_on(code, target)[one.name], True
    return by_door, target


def complaints(code: Sources) -> list[str]:
    """What the code imports and may not, a line each."""
    rules = (package_edges, upward, of_edges, past_the_door, ros_outside_nodes, relative, cycles)
    return sorted(line for rule in rules for line in rule(code))


def package_edges(code: Sources) -> Iterator[str]:
    for one in ours(code):
        package, other = room(one.importer)[0], room(one.target)[0]
        if other != package and other not in BELOW[package]:
            yield f'{one}: {package} does not know {other}'


def upward(code: Sources) -> Iterator[str]:
    for one, (package, here), (other, there) in between_rooms(code):
        order = ORDER[package].split()
        if here not in order:
            yield f'{one}: {here} has no place in the order of {package}'
        elif package == other and there in order and order.index(there) <= order.index(here):
            yield f'{one}: upwards, from {here} to {there}'


def of_edges(code: Sources) -> Iterator[str]:
    """`commands/` and `nodes/` are where things begin: nobody imports them."""
    for one, (_, here), (_, there) in between_rooms(code):
        if there == 'commands' or (there == 'nodes' and here != 'nodes'):
            yield f'{one}: nobody imports {there}'


def past_the_door(code: Sources) -> Iterator[str]:
    for one, _, there in between_rooms(code):
        by_door, target = source_of(code, one)
        loose = '.'.join(there) in code and target == one.target and one.name
        if not (by_door or loose):
            yield f'{one}: not a name that {".".join(there)} hands on'


def ros_outside_nodes(code: Sources) -> Iterator[str]:
    for one in imports(code):
        if ROS.fullmatch(one.target.split('.')[0]) and room(one.importer)[1] != 'nodes':
            yield f'{one}: ROS belongs in nodes/'


def relative(code: Sources) -> Iterator[str]:
    return (f'{one}: name the package' for one in imports(code) if one.target.startswith('.'))


def cycles(code: Sources) -> Iterator[str]:
    """A circle of modules, if there is one; doors are looked through."""
    needs: dict[str, set[str]] = {}
    for one in ours(code):
        needs.setdefault(one.importer, set()).add(source_of(code, one)[1])
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        yield 'circle: ' + ' -> '.join(reversed(error.args[1]))


def package_graph(code: Sources) -> set[tuple[str, str]]:
    """Which package imports which."""
    pairs = ((room(one.importer)[0], room(one.target)[0]) for one in ours(code))
    return {(a, b) for a, b in pairs if a != b}


def room_graph(code: Sources, package: str) -> set[tuple[str, str]]:
    """Which room of a package imports which other of it, without what is said by a longer way."""
    found = ((here, there) for _, here, there in between_rooms(code))
    edges = {(a, b) for (one, a), (other, b) in found if one == other == package}
    return reduced({(a, b) for a, b in edges if not {a, b} & BASE})


def reduced(edges: set[tuple[str, str]]) -> set[tuple[str, str]]:
    """The edges of a graph without circles that no longer way says already."""
    after: dict[str, set[str]] = {}
    for a, b in edges:
        after.setdefault(a, set()).add(b)

    def reach(a: str) -> set[str]:
        return {c for b in after.get(a, ()) for c in {b} | reach(b)}

    return {(a, b) for a, b in edges if not any(b in reach(c) for c in after[a])}
