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
    'jinja2': 'python3-jinja2',
    'lz4': 'python3-rosbags-pip',  # which needs it too
    'markupsafe': 'python3-jinja2',  # which needs it too
    'matplotlib': 'python3-matplotlib',
    'mcap': 'mcap-ros2-support',  # mcap itself has no key
    'numpy': 'python3-numpy',
    'pytest': 'python3-pytest',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'yaml': 'python3-yaml',
    'zstandard': 'python3-rosbags-pip',  # which needs it too
}
WITHOUT_KEY = {'distributed', 'eaik', 'ruckig', 'threadpoolctl'}


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


def test_all_packages_have_one_origin() -> None:
    roots = [ElementTree.parse(package / 'package.xml').getroot() for package in PACKAGES]
    for tag in ('version', 'license', 'maintainer', 'author'):
        told = {(root.findtext(tag), str(root.find(tag).attrib)) for root in roots}
        assert len(told) == 1, tag
    for root in roots:
        assert [url.get('type') for url in root.findall('url')] == ['website', 'bugtracker']


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_a_package_s_changelog_has_its_version_and_points_to_the_whole(package: Path) -> None:
    text = (package / 'CHANGELOG.rst').read_text()
    version = ElementTree.parse(package / 'package.xml').getroot().findtext('version')
    assert text.splitlines()[1] == f'Changelog for package {package.name}'
    assert f'\n{version} (' in text
    assert '``CHANGELOG.md``' in text


@pytest.mark.parametrize('package', PACKAGES, ids=lambda path: path.name)
def test_the_manifest_is_well_formed_for_ament(package: Path) -> None:
    lint = pytest.importorskip('ament_xmllint.main', reason='ament_xmllint is not installed')
    assert lint.main([str(package / 'package.xml')]) == 0
