# SPDX-License-Identifier: Apache-2.0
"""`ros2 run PACKAGE NODE --help`, for every node: what it does, its parameters, an example."""

import subprocess
import sys

import pytest

from calib_capture.nodes import arm_node, capture_node
from calib_solver.nodes import solver_node
from selfcenter_probe.nodes import operator_node, probe_node

NODES = [arm_node, capture_node, probe_node, operator_node, solver_node]
pytestmark = [pytest.mark.system, pytest.mark.timeout(60)]


@pytest.mark.parametrize('node', NODES, ids=lambda node: node.COMMAND.name)
def test_a_node_says_what_it_does_and_what_can_be_set(node, capsys) -> None:
    command = node.COMMAND
    with pytest.raises(SystemExit) as left:
        command.parse([command.name, '--help'])
    said = capsys.readouterr().out
    assert left.value.code == 0
    assert said.startswith(f'usage: ros2 run {command.package} {command.name} ')
    assert command.about in said
    assert f'example:\n  ros2 run {command.package} {command.name}' in said
    assert '-p NAME:=VALUE' in said


@pytest.mark.parametrize(('words', 'code'), [(['--help'], 0), (['faster'], 2)])
def test_a_node_that_is_asked_for_help_or_nonsense_does_not_start(words, code) -> None:
    done = subprocess.run(
        [sys.executable, '-m', 'calib_solver.nodes.solver_node', *words],
        capture_output=True,
        text=True,
        timeout=20,
    )
    assert done.returncode == code
    assert ('magnification (500.0)' in done.stdout) == (code == 0)
    if code:
        assert done.stderr == 'solver: unrecognized arguments: faster (--help says more)\n'
