# SPDX-License-Identifier: Apache-2.0
"""Build backend of the distribution without ROS: setuptools, told which commands there are.

The commands of `calib` are those that setup.py of the packages list under console_scripts and that
lie in a room `commands/`: what `ros2 run` starts without a graph.
"""

from __future__ import annotations

import ast
import shutil
from collections.abc import Iterator
from pathlib import Path

from setuptools.build_meta import *  # noqa: F403

ROOT = Path(__file__).resolve().parent.parent
#: where pyproject.toml has setuptools read entry points from
BUILD = ROOT / 'build'
ENTRY_POINTS = BUILD / 'entry_points.ini'


def console_scripts(setup_file: Path) -> Iterator[str]:
    """The entries `name = package.module:function` of a setup.py, which is read and not run."""
    for node in ast.walk(ast.parse(setup_file.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Dict):
            for key, value in zip(node.keys, node.values, strict=True):
                if isinstance(key, ast.Constant) and key.value == 'console_scripts':
                    yield from ast.literal_eval(value)


def commands() -> list[str]:
    """The entries of all packages that need no ROS graph."""
    files = sorted((ROOT / 'ros2_ws' / 'src').glob('*/setup.py'))
    return [line for file in files for line in console_scripts(file) if '.commands.' in line]


for stale in BUILD.glob('lib*'):  # modules that are gone would come along
    shutil.rmtree(stale)
BUILD.mkdir(exist_ok=True)
ENTRY_POINTS.write_text(
    '\n'.join(
        [
            '[console_scripts]',
            'calib = calib_model.commands.calib:main',
            '',
            '[calib.commands]',
            *commands(),
            '',
        ]
    ),
    encoding='utf-8',
)
