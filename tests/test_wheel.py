# SPDX-License-Identifier: Apache-2.0
"""The suite without ROS: `pip install .` brings every command that needs no graph, and its files.

The wheel is built once and unpacked where Python finds it; `make wheel` installs one in an empty
venv of each interpreter.
"""

from __future__ import annotations

import configparser
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
import zipfile
from collections.abc import Callable
from email import message_from_string
from pathlib import Path

import pytest
from test_package_manifests import imported

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / 'ros2_ws' / 'src'
BAG = ROOT / 'bags' / 'demo' / 'identification'
CODE = ('calib_model', 'calib_capture', 'calib_solver', 'selfcenter_probe')
ELSEWHERE = {'rclpy', 'ament_index_python', 'launch', 'launch_ros', 'calib_interfaces'}
EXTRA = {'ruckig', 'eaik', 'pinocchio', 'coal', 'distributed'}
WHEELS = {'yaml': 'pyyaml'}
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]
Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture(scope='module')
def built(tmp_path_factory) -> Path:
    """The wheel, unpacked: a wheel is no more than a folder of the path."""
    folder = tmp_path_factory.mktemp('wheel')
    words = ['uv', 'build', '--quiet', '--wheel', '--no-build-isolation', '--out-dir', folder, ROOT]
    subprocess.run(['python', '-m', *words], check=True, timeout=90)
    (wheel,) = folder.glob('*.whl')
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / 'unpacked')
    return folder / 'unpacked'


@pytest.fixture(scope='module')
def calib(built, tmp_path_factory) -> Run:
    """`calib WORDS...` in an environment that knows of no workspace."""
    folder = tmp_path_factory.mktemp('working')
    code = 'import sys; from calib_model.commands.calib import main; sys.exit(main())'

    def run(*words: object, before: str = '') -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, '-c', before + code, *map(str, words)],
            cwd=folder,
            env={'PATH': os.defpath, 'PYTHONPATH': str(built), 'HOME': str(folder)},
            capture_output=True,
            text=True,
            timeout=60,
        )

    return run


def metadata_of(built: Path):
    (file,) = built.glob('*.dist-info/METADATA')
    return message_from_string(file.read_text(encoding='utf-8'))


def test_the_result_is_the_workspace_s_but_for_times(calib, tmp_path):
    done = calib('identify', BAG, '--output', tmp_path / 'wheel')
    assert (done.returncode, done.stderr) == (0, '')
    words = ['-m', 'calib_solver.commands.identify', BAG, '--output', tmp_path / 'workspace']
    subprocess.run([sys.executable, *words], check=True, capture_output=True, timeout=60)
    results = [
        json.loads((tmp_path / name / 'result.json').read_text()) for name in ('wheel', 'workspace')
    ]
    for result in results:
        assert result['solver'].pop('seconds') > 0
        assert result['files'].pop('report.html')  # it says when it was made
    assert results[0] == results[1]


def test_every_command_without_a_graph_is_there_with_a_line_of_its_own(calib):
    listed = dict(re.findall(r'^  (\w+) +(.+)$', calib('--help').stdout, re.MULTILINE))
    found = {
        name
        for setup in SOURCES.glob('*/setup.py')
        for name in re.findall(r"'(\w+) = \w+\.commands\.", setup.read_text())
    }
    assert {'identify', 'plan', 'import_csv', 'arm_from_urdf', 'hand_guided'} <= found
    assert set(listed) == found
    assert all(len(what) < 80 for what in listed.values())


def test_what_a_command_says_of_itself_is_said_with_calib(calib):
    said = calib('recover', '--help').stdout
    assert said.startswith('usage: calib recover')
    assert '  calib recover output/cut_bag' in said
    assert 'ros2' not in said


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['identfy'], "calib: there is no command 'identfy' (calib --help lists them)"),
        (['recover'], 'calib recover: the following arguments are required: BAD, OUT'),
    ],
)
def test_a_wrong_word_is_one_line(calib, words, told):
    done = calib(*words)
    assert done.returncode == 2
    assert done.stderr.startswith(told)
    assert done.stderr.count('\n') == 1


def test_the_described_instruments_come_along(calib, built):
    folder = Path(calib('--help').stdout.rpartition(': ')[2].strip())
    assert folder == built / 'calib_bringup' / 'config'
    config = SOURCES / 'calib_bringup' / 'config'
    brought = {path.relative_to(folder) for path in folder.rglob('*.yaml')}
    assert brought == {path.relative_to(config) for path in config.rglob('*.yaml')}
    assert (built / 'selfcenter_probe' / 'config' / 'world_faro.yaml').exists()


def test_every_file_of_the_rooms_comes_along_but_the_nodes(built):
    for package in CODE:
        source = SOURCES / package / package
        expected = {
            path.relative_to(source)
            for path in source.rglob('*')
            if path.suffix not in ('.so', '.c', '.h', '.pyc', '.pyi')
            and path.is_file()
            and path.relative_to(source).parts[0] not in ('nodes', 'config')
        }
        brought = {path.relative_to(built / package) for path in (built / package).rglob('*')}
        assert expected - brought == set()
        assert not (built / package / 'nodes').exists()
    assert list((built / 'calib_solver' / 'problem').glob('_kernel*.so'))


def test_without_a_compiler_numpy_does_it_and_one_line_says_so(calib, tmp_path):
    forget = 'import sys; sys.modules["calib_solver.problem._kernel"] = None\n'
    done = calib('evaluate', BAG, before=forget)
    assert done.stderr == 'calib: installed without a C compiler: numpy calculates, more slowly\n'
    assert done.returncode == 0
    two_sigma = [
        json.loads(each.stdout)['two_sigma']['mean'] for each in (done, calib('evaluate', BAG))
    ]
    assert two_sigma[0] == pytest.approx(two_sigma[1], rel=1e-9)


@pytest.mark.parametrize('module', ['coal', 'pinocchio', 'eaik'])
def test_without_the_extra_planning_says_in_one_line_what_to_install(calib, module):
    forget = f'import sys; sys.modules["{module}"] = None\n'
    done = calib('plan', '--locations', 1, '--poses', 2, '--pool', 1, before=forget)
    assert done.returncode == 2
    assert done.stderr.count('\n') == 1
    assert 'pip install' in done.stderr


def test_the_dependencies_are_what_is_imported(built):
    told = [
        re.match(r'[\w-]+', line)[0].lower() for line in metadata_of(built).get_all('Requires-Dist')
    ]
    modules = imported([folder for folder in built.iterdir() if folder.name in CODE])
    own = {path.name for path in built.iterdir()}
    modules -= own | set(sys.stdlib_module_names) | ELSEWHERE | EXTRA
    assert {WHEELS.get(name, name) for name in modules} <= set(told)
    assert {'eaik', 'pin', 'distributed'} <= set(told)


def test_the_version_is_that_of_the_packages(built):
    versions = {
        ElementTree.parse(path).getroot().findtext('version')
        for path in SOURCES.glob('*/package.xml')
    }
    assert versions == {metadata_of(built)['Version']}


def test_calib_is_the_only_name_it_puts_on_the_path(built):
    (file,) = built.glob('*.dist-info/entry_points.txt')
    parser = configparser.ConfigParser()
    parser.read(file)
    assert list(parser['console_scripts']) == ['calib']
