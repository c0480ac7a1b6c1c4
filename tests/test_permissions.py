# SPDX-License-Identifier: Apache-2.0
"""Callers of the services reach what the owner of the nodes opened, and nothing else."""

import ast
import os
import time
from pathlib import Path

import pytest
import rclpy
import yaml
from calib_interfaces.action import Capture
from calib_interfaces.srv import Compare, Compensate, Evaluate, FitProbe, Identify, Verify
from rclpy.action import ActionClient

from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment
from calib_model.files import safe_yaml as plain_yaml

pytestmark = pytest.mark.system

ROOT = Path(__file__).parents[1]
DEMO = ROOT / 'bags' / 'demo'
SOURCES = sorted((ROOT / 'ros2_ws' / 'src').glob('*/*/*.py'))
PATIENCE = 60.0


@pytest.fixture(scope='module')
def places(tmp_path_factory):
    folder = tmp_path_factory.mktemp('places')
    for name in ('in', 'out', 'closed'):
        (folder / name).mkdir()
    (folder / 'in' / 'bag').symlink_to(DEMO / 'identification')
    (folder / 'out' / 'way_out').symlink_to(folder / 'closed')
    return folder


@pytest.fixture(scope='module')
def graph(places):
    """A solver and a capture node with two open folders, and a node that calls them."""
    domain, context = held_domain(), rclpy.Context()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(context=context, domain_id=domain)
    caller = rclpy.create_node('caller', context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    executor.add_node(caller)
    opened = [
        '-p',
        f"bag_folders:=['{places}/in', '{DEMO}']",
        '-p',
        f"output_folders:=['{places}/out']",
    ]
    nodes = {
        'solver': ('calib_solver.nodes.solver_node', ['--ros-args', *opened]),
        'arm': ('calib_capture.nodes.arm_node', ['--ros-args', '-p', 'time_scale:=0.0']),
        'probe': ('selfcenter_probe.nodes.probe_node', []),
        'capture': (
            'calib_capture.nodes.capture_node',
            ['--ros-args', '-p', 'serve:=true', *opened[2:]],
        ),
    }
    try:
        with Children() as children:
            for name, (module, given) in nodes.items():
                log = places / f'{name}.log'
                children.start(Child(name, module, given, graph_environment(domain), log))
            yield caller
    finally:
        caller.destroy_node()
        rclpy.shutdown(context=context)


def done(caller, future):
    deadline = time.monotonic() + PATIENCE
    while not future.done():
        assert time.monotonic() < deadline, 'no answer'
        caller.executor.spin_once(timeout_sec=0.05)
    return future.result()


def ask(caller, kind, name, **request):
    client = caller.create_client(kind, name)
    assert client.wait_for_service(PATIENCE)
    answer = done(caller, client.call_async(kind.Request(**request)))
    caller.destroy_client(client)
    return answer


def test_open_folders_are_read_and_written(graph, places):
    answer = ask(
        graph, Identify, 'identify', bag=f'{DEMO}/identification', output=f'{places}/out/result'
    )
    assert answer.success, answer.message
    assert (places / 'out' / 'result' / 'arm.yaml').exists()


@pytest.mark.parametrize(
    ('kind', 'name', 'request_'),
    [
        (Identify, 'identify', {'bag': '{0}/closed/bag'}),
        (Identify, 'identify', {'bag': '{0}/in/../closed'}),
        (Identify, 'identify', {'bag': '{demo}/identification:/etc'}),
        (Identify, 'identify', {'bag': '{demo}/identification', 'test': '/etc'}),
        (Identify, 'identify', {'bag': '{demo}/identification', 'arm': '/etc/passwd'}),
        (Identify, 'identify', {'bag': '{demo}/identification', 'prior': '/etc/passwd'}),
        (Identify, 'identify', {'bag': '{demo}/identification', 'output': '{0}/closed/result'}),
        (
            Identify,
            'identify',
            {'bag': '{demo}/identification', 'output': '{0}/out/way_out/result'},
        ),
        (Identify, 'identify', {'bag': '{demo}/identification', 'output': '{0}/out/../../x'}),
        (Identify, 'identify', {'bag': '{demo}/identification', 'scheduler': 'tcp://127.0.0.1:1'}),
        (FitProbe, 'fit_probe', {'bag': '{0}/closed'}),
        (FitProbe, 'fit_probe', {'bag': '{demo}/identification', 'output': '/etc/result'}),
        (Evaluate, 'evaluate', {'bag': '/'}),
        (Evaluate, 'evaluate', {'bag': '{demo}/identification', 'gauge': '/etc/shadow'}),
        (Compensate, 'compensate', {'result': '{0}/closed', 'position': [0.5, 0.0, 0.5]}),
        (Verify, 'verify', {'bag': '{demo}/held_out', 'result': '{0}/closed'}),
        (Verify, 'verify', {'bag': '{demo}/held_out', 'limits': '/etc/passwd'}),
        (Compare, 'compare', {'results': ['/etc', '/root']}),
    ],
)
def test_everything_else_is_refused_in_one_line(graph, places, kind, name, request_):
    request = {
        key: value.format(places, demo=DEMO) if isinstance(value, str) else value
        for key, value in request_.items()
    }
    answer = ask(graph, kind, name, **request)
    assert not answer.success
    assert 'open to callers' in answer.message and '\n' not in answer.message
    assert not any((places / 'closed').iterdir())


def test_a_goal_cannot_have_its_bag_elsewhere(graph, places):
    client = ActionClient(graph, Capture, '/capture/run')
    assert client.wait_for_server(PATIENCE)
    for bag in (f'{places}/closed/bag', f'{places}/out/way_out/bag', '/etc/bag'):
        handle = done(graph, client.send_goal_async(Capture.Goal(bag=bag, locations=[1])))
        result = done(graph, handle.get_result_async()).result
        assert not result.success
        assert 'open to callers' in result.message
    assert not any((places / 'closed').iterdir())
    client.destroy()


def calls(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), ast.unparse(node)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            module = getattr(node, 'module', None)
            for name in [module] if module else [alias.name for alias in node.names]:
                yield f'import {name}', ast.unparse(node)


def test_the_one_loader_of_yaml_is_a_safe_one():
    assert issubclass(plain_yaml._Loader, (yaml.SafeLoader, yaml.CSafeLoader))


@pytest.mark.parametrize('path', SOURCES, ids=[str(path.relative_to(ROOT)) for path in SOURCES])
def test_no_shell_no_pickle_no_eval_and_yaml_as_data(path):
    forbidden = {
        'eval',
        'exec',
        'os.system',
        'os.popen',
        'import pickle',
        'import shelve',
        'import marshal',
        'import dill',
        'yaml.unsafe_load',
        'yaml.full_load',
    }
    for name, text in calls(path):
        assert name not in forbidden, text
        assert 'shell=True' not in text, text
        assert name != 'yaml.load' or text == 'yaml.load(text, _Loader)', text
        assert 'allow_pickle=True' not in text, text
