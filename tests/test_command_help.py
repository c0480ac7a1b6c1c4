# SPDX-License-Identifier: Apache-2.0
"""What commands and nodes say of themselves, and what docs/interfaces.md says of them."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
ROOT = Path(__file__).resolve().parents[1]
from document_interfaces import (
    DOCUMENT,
    PACKAGES,
    commands,
    help_of,
    without_this_machine,
)
from result_schema import ADDED_TOP, DISTANCE, SOLVER, TOP, TWO_SIGMA

from calib_model import topics

COMMANDS = commands()
NAMES = [f'{package} {name}' for package, name, _ in COMMANDS]
pytestmark = pytest.mark.timeout(60)


@pytest.fixture(scope='module')
def document() -> str:
    return DOCUMENT.read_text(encoding='utf-8')


def test_every_package_has_commands() -> None:
    assert {package for package, _, _ in COMMANDS} == set(PACKAGES)


@pytest.mark.parametrize(('package', 'name', 'module'), COMMANDS, ids=NAMES)
def test_help_ends_well_and_has_an_example(package: str, name: str, module: str) -> None:
    example = help_of(name, module).partition('\nexample')[2]
    assert f'  ros2 run {package} {name}' in example


@pytest.mark.parametrize(('package', 'name', 'module'), COMMANDS, ids=NAMES)
def test_the_document_says_what_help_says(
    package: str, name: str, module: str, document: str
) -> None:
    written = document.partition(f'### ros2 run {package} {name}\n```text\n')[2]
    written = written.partition('\n```\n')[0]
    said = without_this_machine(help_of(name, module))
    assert written.split() == said.split(), 'python tools/document_interfaces.py'


def test_the_document_has_every_topic_with_its_type_and_qos(document: str) -> None:
    known = [each for each in vars(topics).values() if isinstance(each, topics.Topic)]
    assert len(known) > 8
    for topic in known:
        row = next(line for line in document.splitlines() if f'`{topic.name}`' in line)
        assert f'`{topic.type}`' in row
        assert ('transient local' in row) == topic.latched
        assert ('best effort' in row) == (not topic.reliable)
        assert str(topic.depth) in row


def test_the_document_has_every_key_of_a_result(document: str) -> None:
    keys = document.partition('### result.json')[2].partition('### Tables')[0]
    for key in TOP | ADDED_TOP | DISTANCE | TWO_SIGMA | SOLVER:
        assert key in keys, key
