# SPDX-License-Identifier: Apache-2.0
"""The shipped SROS2 policy allows each node what it does in the real graph, and nothing else."""

import os
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import rclpy

from calib_bringup.domains import held_domain
from calib_bringup.processes import Child, Children, graph_environment

pytestmark = pytest.mark.system

POLICY = Path(__file__).parents[1] / 'ros2_ws/src/calib_bringup/security/policy.xml'
NODES = {
    'arm': ('calib_capture.nodes.arm_node', ['--ros-args', '-p', 'time_scale:=0.0']),
    'probe': ('selfcenter_probe.nodes.probe_node', []),
    'capture': ('calib_capture.nodes.capture_node', ['--ros-args', '-p', 'serve:=true']),
    'capture_points': (
        'calib_capture.nodes.points_node',
        ['--ros-args', '-p', 'output:={folder}/points'],
    ),
    'solver': ('calib_solver.nodes.solver_node', []),
}
#: what an action is made of
ACTION_SERVICES = ('send_goal', 'cancel_goal', 'get_result')
ACTION_TOPICS = ('feedback', 'status')
Right = tuple[str, str, str]
#: what capture offers last
SERVED = 'actions', 'execute', 'capture/run'


@pytest.fixture(scope='module')
def seen(tmp_path_factory) -> dict[str, set[Right]]:
    """Each node's rights as the graph shows them in use."""
    folder, domain = tmp_path_factory.mktemp('nodes'), held_domain()
    context = rclpy.Context()
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(context=context, domain_id=domain)
    watcher = rclpy.create_node('watcher', context=context)
    try:
        with Children() as children:
            for name, (module, given) in NODES.items():
                log = folder / f'{name}.log'
                given = [word.format(folder=folder) for word in given]
                children.start(Child(name, module, given, graph_environment(domain), log))
            return settled(watcher)
    finally:
        watcher.destroy_node()
        rclpy.shutdown(context=context)


def settled(watcher) -> dict[str, set[Right]]:
    """What is used, once all nodes are there and nothing new has come for a second."""
    last, since, deadline = {}, time.monotonic(), time.monotonic() + 60
    while time.monotonic() < deadline:
        now = {name: used(watcher, name) for name in NODES if name in watcher.get_node_names()}
        if now != last:
            last, since = now, time.monotonic()
        complete = len(now) == len(NODES) and SERVED in now['capture']
        if complete and time.monotonic() - since > 1.5:
            return now
        time.sleep(0.1)
    raise AssertionError(f'the graph did not settle: {last}')


def used(watcher, name: str) -> set[Right]:
    rights: set[Right] = set()
    for way, ask in (
        ('publish', watcher.get_publisher_names_and_types_by_node),
        ('subscribe', watcher.get_subscriber_names_and_types_by_node),
    ):
        rights |= {('topics', way, topic.lstrip('/')) for topic, _ in ask(name, '/')}
    served = watcher.get_service_names_and_types_by_node(name, '/')
    rights |= {('services', 'reply', service.lstrip('/')) for service, _ in served}
    return {whole(right, name) for right in rights}


def whole(right: Right, name: str) -> Right:
    """An action for each of its parts; a node's own services by `~`."""
    kind, way, what = right
    action, _, part = what.rpartition('/_action/')
    if action and part in ACTION_SERVICES + ACTION_TOPICS:
        return 'actions', 'execute', action
    return kind, way, what.replace(f'{name}/', '~/', 1) if kind == 'services' else what


def allowed(name: str) -> set[Right]:
    root = ET.parse(POLICY).getroot()
    profile = root.find(f".//enclave[@path='/calib/{name}']/profiles/profile[@node='{name}']")
    assert profile is not None, f'no profile of {name}'
    return {
        (group.tag, way, str(one.text))
        for group in profile
        for way, verdict in group.attrib.items()
        for one in group
        if verdict == 'ALLOW'
    }


#: what a node does only while a capture is under way, which none is here
AT_WORK: dict[str, set[Right]] = {
    'capture': {('topics', 'publish', 'arm_controller/joint_trajectory')}
}


@pytest.mark.parametrize('name', NODES)
def test_each_node_may_do_what_it_does_and_no_more(seen, name):
    assert seen[name] | AT_WORK.get(name, set()) == allowed(name)
