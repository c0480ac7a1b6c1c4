# SPDX-License-Identifier: Apache-2.0
"""The solver asked by several at once, by one that goes away, and while it has much to do."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
pytest.importorskip('calib_interfaces.srv', reason='the workspace is not built')
from calib_interfaces.srv import Evaluate, Identify
from rclpy.executors import SingleThreadedExecutor

from calib_bringup.processes import Child, Children, graph_environment
from calib_model.descriptions import parse_arm, read_description

DEMO = str(Path(__file__).resolve().parents[1] / 'bags/demo/identification')
LONG = {'bag': DEMO, 'monte_carlo': 2000}  # minutes
MORE = 0.5  # s that a call may take beyond its own time
CALL = """
import sys, rclpy
from calib_interfaces.srv import Identify
rclpy.init()
node = rclpy.create_node('gone')
client = node.create_client(Identify, 'identify')
client.wait_for_service(30)
future = client.call_async(Identify.Request(bag=sys.argv[1], monte_carlo=20))
print('asked', flush=True)
rclpy.spin_until_future_complete(node, future)
"""
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


class Asker:
    """Calls the solver; `sent` does so without waiting."""

    def __init__(self, context, executor, node, process):
        self.process, self._executor = process, executor
        self._clients = {
            Identify: node.create_client(Identify, 'identify'),
            Evaluate: node.create_client(Evaluate, 'evaluate'),
        }
        for client in self._clients.values():
            assert client.wait_for_service(30), 'no solver'

    def sent(self, kind, **request):
        return self._clients[kind].call_async(kind.Request(**request))

    def answer(self, future):
        self._executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done(), 'no answer'
        assert future.result().success, future.result().message
        return future.result()

    def seconds(self, kind, **request) -> float:
        begin = time.monotonic()
        self.answer(self.sent(kind, **request))
        return time.monotonic() - begin


@pytest.fixture
def ask(domain, tmp_path, monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    env = graph_environment(domain)
    folders = [
        '--ros-args',
        '-p',
        f'bag_folders:=[{Path(DEMO).parent}]',
        '-p',
        f'output_folders:=[{tmp_path}]',
    ]
    with Children() as children:
        solver = children.start(
            Child('solver', 'calib_solver.nodes.solver_node', folders, env, tmp_path / 'solver.log')
        )
        context = rclpy.Context()
        rclpy.init(context=context, domain_id=domain)
        node = rclpy.create_node('asker', context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        asker = Asker(context, executor, node, solver)
        asker.env = env
        yield asker
        assert solver.process.poll() is None, 'the solver is gone'
        solver.process.kill()  # it would finish what it is at first
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert 'Traceback' not in (tmp_path / 'solver.log').read_text()


def test_others_are_answered_while_long_identifications_run(ask):
    alone = {}
    for kind in (Evaluate, Identify):
        ask.seconds(kind, bag=DEMO)
        alone[kind] = statistics.median(ask.seconds(kind, bag=DEMO) for _ in range(5))
    first = ask.sent(Identify, **LONG)
    time.sleep(1.0)
    meanwhile = {
        kind: statistics.median(ask.seconds(kind, bag=DEMO) for _ in range(5)) for kind in alone
    }
    assert not first.done()
    print(alone, meanwhile)
    for kind, seconds in meanwhile.items():
        assert seconds < alone[kind] + MORE
    several = [ask.sent(Identify, **LONG) for _ in range(5)]
    assert ask.seconds(Evaluate, bag=DEMO) < 10
    assert not any(future.done() for future in (first, *several))


def test_two_results_into_one_folder_are_one_or_the_other_and_into_two_are_both(ask, tmp_path):
    objectives = ('distance_repeatability', 'distance')
    for folders in (('one', 'one'), ('a', 'b')):
        calls = [
            ask.sent(Identify, bag=DEMO, objective=objective, output=str(tmp_path / folder))
            for objective, folder in zip(objectives, folders, strict=True)
        ]
        for call in calls:
            ask.answer(call)
        for number, folder in enumerate(folders):
            record = json.loads((tmp_path / folder / 'result.json').read_text())
            if folders[0] != folders[1]:
                assert record['objective'] == objectives[number]
            assert record['objective'] in objectives
            written = read_description(tmp_path / folder / 'arm.yaml', parse_arm)
            named = {each['name']: each['identified'] for each in record['parameters']}
            lengths = [named[f'a{number}'] for number in range(1, written.n + 1)]
            assert written.geometry[0].tolist() == pytest.approx(lengths, abs=1e-15)
            assert not [each for each in (tmp_path / folder).iterdir() if '.part' in each.name]


def test_a_client_that_goes_away_leaves_the_solver_to_others(ask):
    for _ in range(2):
        client = subprocess.Popen(
            [sys.executable, '-c', CALL, DEMO],
            env={**os.environ, **ask.env},
            stdout=subprocess.PIPE,
            text=True,
        )
        assert client.stdout.readline() == 'asked\n'
        time.sleep(0.3)
        client.kill()
        client.communicate()
    for _ in range(3):
        ask.seconds(Evaluate, bag=DEMO)
        ask.seconds(Identify, bag=DEMO)
