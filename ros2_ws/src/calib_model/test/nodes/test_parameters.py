# SPDX-License-Identifier: Apache-2.0
"""Parameters as every node declares them: told of, held to their range, changed."""

import pytest

rclpy = pytest.importorskip('rclpy', reason='no ROS 2 here')
from rclpy.parameter import Parameter

from calib_model.command_line import UsageError
from calib_model.errors import ParameterError
from calib_model.nodes.lifecycle import NodeCommand
from calib_model.nodes.parameters import MOST_NAMED, Parameters, Proposal, Sheet, warn_of_unknown

pytestmark = [pytest.mark.system, pytest.mark.timeout(30)]


@pytest.fixture
def make(domain):
    """Nodes started with parameters given on the command line."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain)
    nodes = []

    def made(*given):
        words = ['--ros-args', *(part for pair in given for part in ('-p', pair))]
        arguments = words if given else []
        nodes.append(rclpy.create_node('n', context=context, cli_args=arguments))
        return nodes[-1]

    yield made
    for node in nodes:
        node.destroy_node()
    rclpy.shutdown(context=context)


def declare(node, changed=None):
    parameters = Parameters(node)
    return (
        parameters.text('path', '', 'a file'),
        parameters.number('rate', 10.0, 'Hz', 1.0, 100.0, changed),
        parameters.whole('poses', 60, 'per sphere', 1, 1000),
        parameters.flag('serve', False, 'wait for goals'),
        parameters.wholes('spheres', 'to probe'),
    )


def answer(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


def test_what_is_given_comes_back_and_a_whole_number_is_a_number(make):
    assert declare(make()) == ('', 10.0, 60, False, ())
    given = make('path:=x.yaml', 'rate:=20', 'poses:=5', 'serve:=true', 'spheres:=[1, 6]')
    assert declare(given) == ('x.yaml', 20.0, 5, True, (1, 6))


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ('rate:=fast', "parameter 'rate': expected a number from 1 to 100, got 'fast'"),
        ('rate:=0.5', "parameter 'rate': expected a number from 1 to 100, got 0.5"),
        ('rate:=.nan', "parameter 'rate': expected a number from 1 to 100, got nan"),
        ('poses:=0', "parameter 'poses': expected a number from 1 to 1000, got 0"),
    ],
)
def test_what_is_out_of_range_is_refused_at_the_start(make, given, said):
    node = make(given)
    with pytest.raises(ParameterError) as refused:
        declare(node)
    assert str(refused.value) == said


def test_a_change_is_checked_and_then_told(make):
    told = []
    node = make()
    declare(node, told.append)
    assert answer(node, 'rate', 50).successful
    assert told == [50.0]
    for wrong in (0.0, 500, 'fast', True):
        refusal = answer(node, 'rate', wrong)
        assert not refusal.successful
        assert 'rate' in refusal.reason
    assert told == [50.0]
    assert node.get_parameter('rate').value == 50


def test_what_may_not_change_is_read_only_and_everything_is_described(make):
    node = make()
    declare(node, print)
    for name, value in (('path', 'y'), ('poses', 7), ('serve', True)):
        assert 'read-only' in answer(node, name, value).reason
    descriptor = node.describe_parameter('rate')
    assert (descriptor.description, descriptor.read_only) == ('Hz', False)
    assert descriptor.floating_point_range[0].to_value == 100.0
    assert node.describe_parameter('poses').integer_range[0].to_value == 1000


def test_a_proposal_is_the_node_with_other_values(make):
    node = make('rate:=20')
    declare(node, print)
    assert declare(Proposal(node))[1] == 20.0
    assert declare(Proposal(node, [Parameter('rate', value=30.0)]))[1] == 30.0
    with pytest.raises(ParameterError):
        declare(Proposal(node, [Parameter('rate', value=300.0)]))


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        (
            (
                'poses:=5',
                'use_sim_time:=false',
                'start_type_description_service:=true',
                'qos_overrides./joint_states.subscription.depth:=5',
            ),
            '',
        ),
        (('spherse:=[1]',), "no parameter 'spherse': did you mean 'spheres'?"),
        (
            ('magnification:=2.0', 'rat:=3.0', 'zzz.y:=1'),
            "no parameter 'rat': did you mean 'rate'? no parameters 'magnification', 'zzz.y'",
        ),
        (('zzz:=1',), "no parameter 'zzz'"),
    ],
)
def test_what_is_given_and_not_known_is_one_line_of_warning(make, capfd, given, said):
    node = make(*given)
    declare(node)
    warn_of_unknown(node)
    lines = capfd.readouterr().err.splitlines()
    assert [line.partition('[n]: ')[2] for line in lines] == ([said] if said else [])
    assert all(line.startswith('[WARN]') for line in lines)


def test_a_shared_file_of_many_parameters_is_still_one_line(make, capfd):
    node = make(*(f'of_another_node_{number}:=1' for number in range(40)))
    declare(node)
    warn_of_unknown(node)
    line = capfd.readouterr().err.strip()
    assert line.count('of_another_node_') == MOST_NAMED
    assert line.endswith(f' and {40 - MOST_NAMED} more')


def test_help_names_every_parameter_with_default_range_and_example(capsys):
    command = NodeCommand('pkg', 'exe', 'Does it.', 'ros2 run pkg exe', lambda n: declare(n, print))
    with pytest.raises(SystemExit) as left:
        command.parse(['exe', '--help', '--ros-args', '-p', 'rate:=3'])
    assert left.value.code == 0
    said = capsys.readouterr().out
    for part in (
        'usage: ros2 run pkg exe',
        'Does it.',
        'rate (10.0)',
        'Hz; from 1 to 100; may be set while',
        'poses (60)',
        'spheres\n',
        'example:\n  ros2 run pkg exe',
    ):
        assert part in said


def test_an_argument_that_nobody_takes_is_refused():
    command = NodeCommand('pkg', 'exe', 'Does it.', 'ros2 run pkg exe', declare)
    command.parse(['exe', '--ros-args', '-p', 'rate:=3'])
    with pytest.raises(UsageError, match='unrecognized arguments: x'):
        command.parse(['exe', 'x'])


def test_a_sheet_without_parameters_says_so():
    assert Sheet().text() == 'It has no parameters.'
