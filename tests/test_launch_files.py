# SPDX-License-Identifier: Apache-2.0
"""Launch files and layouts: what they start and show is there, with the arguments they name."""

import importlib.util
import json
import os
import re
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from ament_index_python.packages import get_package_prefix

import calib_model.topics as topics
from calib_bringup import launching

BRINGUP = Path(__file__).resolve().parent.parent / 'ros2_ws' / 'src' / 'calib_bringup'
NOT_OURS = {'robot_state_publisher', 'rviz2'}
FILES = ('demo', 'capture', 'solver', 'replay')
KNOWN = {topic.name for topic in vars(topics).values() if isinstance(topic, topics.Topic)}


class Recorded:
    """An action of launch that only remembers what it was made of."""

    def __init__(self, *given, **named):
        self.given, self.named = given, named


def recorder(name):
    return type(name, (Recorded,), {})


@pytest.fixture
def launch_file(monkeypatch):
    """Loads a launch file with stand-ins for launch and launch_ros, which a wheel does not have."""
    launch = types.ModuleType('launch')
    launch.LaunchContext, launch.LaunchDescription = recorder('Context'), recorder('Description')
    actions = types.ModuleType('launch.actions')
    for name in ('DeclareLaunchArgument', 'ExecuteProcess', 'OpaqueFunction', 'Shutdown'):
        setattr(actions, name, recorder(name))
    ros_actions = types.ModuleType('launch_ros.actions')
    ros_actions.Node = recorder('Node')
    substitutions = types.ModuleType('launch_ros.substitutions')
    substitutions.ExecutableInPackage = recorder('ExecutableInPackage')
    for module in (launch, actions, ros_actions, substitutions, types.ModuleType('launch_ros')):
        monkeypatch.setitem(sys.modules, module.__name__, module)

    def load(name):
        path = BRINGUP / 'launch' / f'{name}.launch.py'
        spec = importlib.util.spec_from_file_location(f'{name}_launch', path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


def declared(module):
    """Default and description of every argument by its name."""
    (actions,) = module.generate_launch_description().given
    return {action.given[0]: action.named for action in actions if action.given}


def started(module, **given):
    """Options of every node by its executable, with these arguments and defaults else."""
    told = {name: named['default_value'] or '' for name, named in declared(module).items()}
    assert set(given) <= set(told)
    context = types.SimpleNamespace(launch_configurations={**told, **given})
    return {node.named['executable']: node.named for node in map(named, module.nodes(context))}


def named(action):
    """A process with an executable of a package, told of as a node is."""
    if 'cmd' in action.named:
        executable, *words = action.named['cmd']
        action.named.update(executable.named, arguments=words)
    return action


@pytest.mark.parametrize('name', FILES)
def test_every_argument_is_described_and_every_executable_is_there(launch_file, name):
    module = launch_file(name)
    for argument, named in declared(module).items():
        assert len(named['description']) > 5, argument
    more = {'rviz': 'true'} if 'rviz' in declared(module) else {}
    for executable, named in started(module, **more).items():
        if named['package'] not in NOT_OURS:
            prefix = Path(get_package_prefix(named['package']))
            assert os.access(prefix / 'lib' / named['package'] / executable, os.X_OK)


def test_the_demo_gets_its_options_and_its_end_is_the_end(launch_file):
    (demo,) = started(launch_file('demo'), seed='3', output='here').values()
    assert demo['arguments'] == ['--variant', 'kr5', '--output', 'here', '--seed', '3']
    assert type(demo['on_exit']).__name__ == 'Shutdown'


def test_capture_passes_to_every_node_what_it_knows_and_only_what_was_given(launch_file):
    module = launch_file('capture')
    nodes = started(module, locations='[1, 2]', arm='my arm.yaml', serve='true', seed='4')
    assert set(nodes) == {'capture', 'sim_arm', 'sim_probe'}
    assert nodes['capture']['parameters'] == [
        {'output': 'capture', 'locations': [1, 2], 'poses_per_sphere': 60, 'serve': True}
    ]
    assert nodes['sim_arm']['parameters'] == [{'arm': 'my arm.yaml', 'time_scale': 1.0}]
    assert nodes['sim_probe']['parameters'] == [{'arm': 'my arm.yaml', 'seed': 4}]
    assert set(started(module, simulate='false')) == {'capture'}
    named = started(module, controller='scaled_controller')
    for name in ('capture', 'sim_arm'):
        assert named[name]['parameters'][0]['controller'] == 'scaled_controller'
    assert 'controller' not in named['sim_probe']['parameters'][0]
    shown = started(module, rviz='true')
    assert '<robot' in shown['robot_state_publisher']['parameters'][0]['robot_description']
    assert Path(shown['rviz2']['arguments'][1]).is_file()


def test_namespace_topics_and_a_file_of_parameters_reach_every_node(launch_file):
    module = launch_file('capture')
    nodes = started(
        module,
        namespace='left',
        params_file='mine.yaml',
        joint_states='/cell/joints',
        trajectory='jtc/joint_trajectory',
        locations='[2]',
    )
    for node in nodes.values():
        assert node['namespace'] == 'left'
        assert node['remappings'] == [
            ('joint_states', '/cell/joints'),
            ('arm_controller/joint_trajectory', 'jtc/joint_trajectory'),
        ]
        assert node['parameters'][0] == 'mine.yaml'
    assert nodes['capture']['parameters'][1]['locations'] == [2]
    (solver,) = started(launch_file('solver'), namespace='right', params_file='m.yaml').values()
    assert solver['namespace'] == 'right'
    assert solver['parameters'][0] == 'm.yaml'


def test_replay_needs_a_bag_and_passes_flags_on(launch_file):
    module = launch_file('replay')
    assert declared(module)['bag']['default_value'] is None
    (replay,) = started(module, bag='a bag', loop='true', clock='false').values()
    assert replay['arguments'] == ['a bag', '--rate', '1.0', '--loop']


def test_an_argument_that_cannot_be_read_is_named():
    arguments = (launching.Argument('poses', 'per sphere'),)
    with pytest.raises(launching.ParameterError, match="'poses'"):
        launching.parameters(arguments, {'poses': '[1'})
    with pytest.raises(launching.ParameterError, match="'serve'.*'perhaps'"):
        launching.chosen('serve', {'serve': 'perhaps'})


def test_the_layouts_show_topics_that_there_are():
    rviz = yaml.safe_load((BRINGUP / 'rviz' / 'calibration.rviz').read_text())
    shown = [
        display[key]['Value']
        for display in rviz['Visualization Manager']['Displays']
        for key in ('Topic', 'Description Topic')
        if key in display
    ]
    assert shown == ['/robot_description', '/capture/markers', '/solver/markers']
    panels = json.loads((BRINGUP / 'foxglove' / 'calibration.json').read_text())['configById']
    scene = panels['3D!scene']
    shown = {
        *scene['topics'],
        scene['layers']['arm']['topic'],
        panels['RawMessages!poses']['topicPath'],
        panels['DiagnosticSummary!probe']['topicToRender'],
    }
    plots = [
        path['value']
        for name, panel in panels.items()
        if name.startswith('Plot')
        for path in panel['paths']
    ]
    shown |= {path.split('.')[0] for path in plots}
    assert {'/capture/markers', '/solver/markers', '/capture/quality'} <= shown <= KNOWN


@pytest.mark.parametrize('layout', ['foxglove/calibration.json', 'plotjuggler/calibration.xml'])
def test_the_layouts_plot_fields_that_the_messages_have(layout):
    interfaces = pytest.importorskip('calib_interfaces.msg', reason='the workspace is not built')
    text = (BRINGUP / layout).read_text()
    of_run = set(re.findall(r'/capture/quality[./](\w+)', text))
    of_spheres = set(re.findall(r'/capture/quality[./]spheres\[\d\][./](\w+)', text))
    assert of_run <= set(interfaces.CaptureQuality.get_fields_and_field_types())
    assert of_spheres <= set(interfaces.SphereQuality.get_fields_and_field_types())
    assert {'two_sigma', 'two_sigma_identified', 'taken', 'left', 'spheres'} <= of_run
    assert 'two_sigma_identified' in of_spheres
    if layout.endswith('.xml'):
        curves = [curve.get('name') for curve in ET.fromstring(text).iter('curve')]
        assert len(curves) == len(set(curves)) > 20
