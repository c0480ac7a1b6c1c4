# SPDX-License-Identifier: Apache-2.0
"""package.xml of every package: what its modules import is what rosdep is told to install."""

import ast
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

SOURCES = Path(__file__).resolve().parent.parent / 'ros2_ws' / 'src'
PACKAGES = sorted(path.parent for path in SOURCES.glob('*/package.xml'))
#: modules to the keys that bring them, as rosdep knows them; ROS packages have their own names
KEYS = {
    'hypothesis': 'python3-hypothesis',
    'lz4': 'python3-rosbags-pip',  # which needs it too
    'matplotlib': 'python3-matplotlib',
    'mcap': 'mcap-ros2-support',  # mcap itself has no key
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
    'zstandard': 'python3-rosbags-pip',  # which needs it too
}
WITHOUT_KEY = {'distributed', 'eaik', 'threadpoolctl'}


def imported(folders: list[Path]) -> set[str]:
    """Modules of other packages that the code in some folders imports."""
    own = {path.stem for folder in folders for path in folder.rglob('*.py')}
    own |= {path.stem for path in SOURCES.glob('*/test/*.py')}  # tests borrow from one another
    found = set()
    for path in (path for folder in folders for path in folder.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                found |= {name.name.split('.')[0] for name in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                found.add(node.module.split('.')[0])
    return found - own - set(sys.stdlib_module_names)


def declared(package: Path, *kinds: str) -> set[str]:
    root = ElementTree.parse(package / 'package.xml').getroot()
    return {str(element.text) for kind in kinds for element in root.findall(kind)}


def needed(package: Path, folders: list[str]) -> set[str]:
    modules = imported([package / folder for folder in folders]) - {package.name} - WITHOUT_KEY
    return {KEYS.get(module, module) for module in modules}


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_what_a_package_imports_is_declared(package: Path) -> None:
    told = declared(package, 'depend', 'exec_depend')
    assert needed(package, [package.name, 'launch']) - told == set()
    told |= declared(package, 'test_depend')
    # bringup depends on the packages whose tests borrow from it: colcon takes no circle
    assert needed(package, ['test']) - told - {'calib_bringup'} == set()


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_no_python_package_is_declared_that_nothing_imports(package: Path) -> None:
    told = declared(package, 'depend', 'exec_depend') & set(KEYS.values())
    assert told - needed(package, [package.name, 'launch']) == set()


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_nothing_is_declared_twice(package: Path) -> None:
    root = ElementTree.parse(package / 'package.xml').getroot()
    lines = [(element.tag, element.text) for element in root if element.tag.endswith('depend')]
    assert len(lines) == len(set(lines))
