# SPDX-License-Identifier: Apache-2.0
"""The stand-in for ros2, as a user meets it: real processes on a real graph."""

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from calib_bringup.domains import held_domain

pytestmark = pytest.mark.system

ROOT = Path(__file__).resolve().parent.parent
STAND_IN = ROOT / 'tools' / 'ros2' / 'ros2'
PEER = Path(__file__).with_name('ros2_peer.py')


@pytest.fixture(scope='module')
def environment() -> dict[str, str]:
    """What a shell that has sourced env.bash passes on, in a domain of this run's own."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    variables = dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)
    return variables | {
        'ROS_DOMAIN_ID': str(held_domain()),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }


@pytest.fixture(scope='module')
def peer(environment: dict[str, str]) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, PEER], env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == 'ready\n'
        yield process
        process.send_signal(signal.SIGINT)


@pytest.fixture
def ros2(environment: dict[str, str]):
    def run(*words: str, stdin: str | None = None) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [STAND_IN, *words],
            env=environment,
            capture_output=True,
            text=True,
            timeout=30,
            input=stdin,
        )

    return run


@pytest.fixture
def package(tmp_path: Path, environment: dict[str, str]):
    """`ros2 run` in an overlay whose one package, `tool_box`, has one executable, `tool`."""
    index = tmp_path / 'share' / 'ament_index' / 'resource_index' / 'packages'
    index.mkdir(parents=True)
    (index / 'tool_box').touch()
    tool = tmp_path / 'lib' / 'tool_box' / 'tool'
    tool.parent.mkdir(parents=True)
    overlay = environment | {'AMENT_PREFIX_PATH': f'{tmp_path}:{environment["AMENT_PREFIX_PATH"]}'}

    def start(script: str, *words: str) -> subprocess.Popen[str]:
        tool.write_text(f'#!{sys.executable}\n{script}')
        tool.chmod(0o755)
        return subprocess.Popen(
            [STAND_IN, 'run', 'tool_box', 'tool', *words],
            env=overlay,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )

    return start


def test_run_passes_all_arguments_on(package) -> None:
    words = ['--rate', '2', 'BAG', '--help', '--ros-args', '-p', 'rate:=5.0', '-r', '__ns:=/x']
    output, _ = package('import sys; print(sys.argv[1:])', *words).communicate(timeout=20)
    assert output == f'{words}\n'


def test_run_exits_as_the_executable_does(package) -> None:
    process = package('import sys; print("no such bag"); sys.exit(2)')
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 2
    assert output.splitlines()[0] == 'no such bag'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_run_lets_signals_reach_the_executable(package, number: signal.Signals) -> None:
    process = package(
        'import signal, sys, time\n'
        'def leave(number, frame):\n'
        '    print("signal", number); sys.exit(7)\n'
        f'signal.signal({int(number)}, leave)\n'
        'print("up", flush=True)\n'
        'time.sleep(20)\n'
    )
    assert process.stdout.readline() == 'up\n'
    process.send_signal(number)
    output, _ = process.communicate(timeout=10)
    assert output.splitlines()[0] == f'signal {int(number)}'
    assert process.returncode == 7


def test_run_says_which_package_is_missing(ros2) -> None:
    result = ros2('run', 'no_such_package', 'x')
    assert result.returncode == 1
    assert result.stderr.startswith("Package 'no_such_package' not found")
    alike = ros2('run', 'calib_solvr', 'x')
    assert 'did you mean calib_solver' in alike.stderr


def test_run_says_that_the_executable_is_missing(ros2) -> None:
    result = ros2('run', 'calib_solver', 'no_such_executable')
    assert result.returncode == 1
    assert re.fullmatch(r'No executable found; there is .*identify.*solver.*\n', result.stderr)
    assert 'did you mean identify?' in ros2('run', 'calib_solver', 'identfy').stderr


def test_service_list_shows_names_types_and_count(ros2, peer) -> None:
    names = ros2('service', 'list').stdout.splitlines()
    assert '/switch' in names
    assert '/peer/get_parameters' in names
    assert '/switch [std_srvs/srv/SetBool]' in ros2('service', 'list', '-t').stdout.splitlines()
    assert ros2('service', 'list', '--count-services').stdout == f'{len(names)}\n'


def test_service_type_prints_the_type_or_fails(ros2, peer) -> None:
    assert ros2('service', 'type', '/switch').stdout == 'std_srvs/srv/SetBool\n'
    unknown = ros2('service', 'type', '--spin-time', '0.5', '/nowhere')
    assert (unknown.returncode, unknown.stdout) == (1, '')


def test_service_call_prints_request_and_response_as_ros2cli_does(ros2, peer) -> None:
    result = ros2('service', 'call', '/switch', 'std_srvs/srv/SetBool', '{data: true}')
    assert result.returncode == 0
    assert result.stdout.removeprefix('waiting for service to become available...\n') == (
        'requester: making request: std_srvs.srv.SetBool_Request(data=True)\n\n'
        "response:\nstd_srvs.srv.SetBool_Response(success=True, message='switched')\n\n"
    )


def test_service_call_reads_the_request_from_stdin(ros2, peer) -> None:
    result = ros2('service', 'call', '/switch', 'std_srvs/SetBool', '--stdin', stdin='data: true')
    assert 'SetBool_Response(success=True' in result.stdout


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ('{dota: true}', "no attribute 'dota'"),
        ('{data: 3}', "'data'"),
        ('{data: [}', 'not YAML'),
        ('just text', 'expected'),
    ],
)
def test_service_call_refuses_a_bad_request_in_one_line(ros2, values: str, reason: str) -> None:
    result = ros2('service', 'call', '/switch', 'std_srvs/srv/SetBool', values)
    assert (result.returncode, result.stdout) == (1, '')
    assert re.fullmatch(r'Failed to populate field: .*\n', result.stderr)
    assert reason in result.stderr


def test_service_call_refuses_an_unknown_type_in_one_line(ros2) -> None:
    result = ros2('service', 'call', '/switch', 'std_srvs/srv/Nothing')
    assert result.returncode == 1
    assert result.stderr.startswith('The passed service type is invalid; ')
    assert 'std_srvs/srv/SetBool' in result.stderr


def test_what_is_waited_for_in_vain_is_compared_with_what_there_is(environment, peer) -> None:
    asked = {
        'did you mean /switch': ['service', 'call', '/swich', 'std_srvs/srv/SetBool'],
        'of type std_srvs/srv/SetBool': ['service', 'call', '/switch', 'std_srvs/srv/Empty'],
        'did you mean /run': ['action', 'send_goal', '/runs', CAPTURE],
    }
    waiting = {
        said: subprocess.Popen(
            [STAND_IN, *words],
            env=environment,
            text=True,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        for said, words in asked.items()
    }
    for said, process in waiting.items():
        line = process.stderr.readline()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=10)
        assert said in line


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_service_call_waits_for_a_service_until_interrupted(environment, number) -> None:
    with subprocess.Popen(
        [STAND_IN, 'service', 'call', '/nowhere', 'std_srvs/srv/Empty'],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout.readline() == 'waiting for service to become available...\n'
        time.sleep(0.5)
        assert process.poll() is None
        process.send_signal(number)
        assert process.communicate(timeout=10) == ('', '')
        assert process.returncode == number


def test_nested_fields_arrays_and_types_of_a_request_are_filled(environment) -> None:
    script = (
        'from standin.fields import as_yaml, fill, parse\n'
        'from calib_interfaces.srv import Identify\n'
        'from trajectory_msgs.msg import JointTrajectory\n'
        'request = Identify.Request()\n'
        "fill(request, parse('{bag: 12, fix: [a1, d2]}'))\n"
        "assert (request.bag, request.fix) == ('12', ['a1', 'd2'])\n"
        'path = JointTrajectory()\n'
        "fill(path, parse('{header: {frame_id: base}, points: [{positions: [1, 2]}]}'))\n"
        "assert path.header.frame_id == 'base'\n"
        'assert list(path.points[0].positions) == [1.0, 2.0]\n'
    )
    subprocess.run(
        [sys.executable, '-c', script], cwd=STAND_IN.parent, env=environment, check=True, timeout=30
    )


def test_topic_list_shows_names_types_and_count(ros2, peer) -> None:
    names = ros2('topic', 'list').stdout.splitlines()
    assert {'/chatter', '/description', '/joint_states'} <= set(names)
    assert '/chatter [std_msgs/msg/String]' in ros2('topic', 'list', '-t').stdout.splitlines()
    assert ros2('topic', 'list', '-c').stdout == f'{len(names)}\n'
    published = ros2('topic', 'list', '--verbose').stdout.split('Subscribed topics:')[0]
    assert ' * /joint_states [sensor_msgs/msg/JointState] 1 publisher\n' in published


@pytest.mark.parametrize('topic', ['/chatter', '/joint_states', '/description'])
def test_topic_echo_connects_whatever_quality_is_offered(ros2, peer, topic: str) -> None:
    result = ros2('topic', 'echo', '--once', topic)
    assert result.returncode == 0
    assert result.stdout.endswith('\n---\n')


def test_topic_echo_prints_yaml_as_ros2cli_does(ros2, peer) -> None:
    assert ros2('topic', 'echo', '--once', '/joint_states').stdout == (
        "header:\n  stamp:\n    sec: 0\n    nanosec: 0\n  frame_id: ''\n"
        'name:\n- a1\n- a2\nposition:\n- 0.5\n- -1.0\nvelocity: []\neffort: []\n---\n'
    )


def test_topic_echo_shows_one_field(ros2, peer) -> None:
    echo = ('topic', 'echo', '--once', '/joint_states', '--field')
    assert ros2(*echo, 'position').stdout == "array('d', [0.5, -1.0])\n---\n"
    assert ros2(*echo, 'header.stamp').stdout == 'sec: 0\nnanosec: 0\n---\n'
    refused = ros2(*echo, 'positions')
    assert refused.returncode == 1
    assert refused.stderr.startswith("Invalid field 'positions'")


def test_topic_echo_truncates_unless_full_length_is_asked_for(ros2, peer) -> None:
    echo = ('topic', 'echo', '--once', '/description')
    assert ros2(*echo).stdout == f'data: {"a" * 128}...\n---\n'
    assert ros2(*echo, '--truncate-length', '3').stdout == 'data: aaa...\n---\n'
    assert ros2(*echo, '--full-length').stdout == f'data: {"a" * 200}\n---\n'


def test_topic_echo_says_that_nobody_publishes(ros2, peer) -> None:
    result = ros2('topic', 'echo', '--spin-time', '0.5', '/nowhere')
    assert result.returncode == 1
    assert 'Could not determine the type for the passed topic; there is /chatter' in result.stderr


def test_node_list_shows_nodes_but_not_itself(ros2, peer) -> None:
    assert ros2('node', 'list').stdout == '/peer\n'
    assert '/_ros2cli_' in ros2('node', 'list', '--all').stdout


def test_topic_hz_prints_the_rate_as_ros2cli_does(environment, peer) -> None:
    with subprocess.Popen(
        [STAND_IN, 'topic', 'hz', '/chatter'], env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        lines = [process.stdout.readline() for _ in range(4)]
        process.send_signal(signal.SIGINT)
    rate = re.fullmatch(r'average rate: (\d+\.\d{3})\n', lines[2])
    assert rate is not None
    assert 15 < float(rate[1]) < 21  # published at 20 Hz
    assert re.fullmatch(r'\tmin: [\d.]+s max: [\d.]+s std dev: [\d.]+s window: \d+\n', lines[3])


CAPTURE = 'calib_interfaces/action/Capture'


def test_action_list_shows_names_and_types(ros2, peer) -> None:
    assert ros2('action', 'list').stdout == '/run\n'
    assert ros2('action', 'list', '-t').stdout == f'/run [{CAPTURE}]\n'


def test_send_goal_prints_feedback_and_result_as_ros2cli_does(ros2, peer) -> None:
    result = ros2(
        'action', 'send_goal', '--feedback', '/run', CAPTURE, '{poses_per_sphere: 2, bag: here}'
    )
    assert result.returncode == 0
    steps = re.findall(r'^(?:[A-Z][\w ]*:|\w[^:]*\.\.\.)', result.stdout, re.MULTILINE)
    assert steps == [
        'Waiting for an action server to become available...',
        'Sending goal:',
        'Goal accepted with ID:',
        'Feedback:',
        'Feedback:',
        'Result:',
        'Goal finished with status:',
    ]
    assert result.stdout.endswith('Goal finished with status: SUCCEEDED\n')
    assert "Result:\n    success: true\nmessage: ''\nbag: here\n" in result.stdout


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_goal_is_cancelled_first(environment, peer, number) -> None:
    with subprocess.Popen(
        [STAND_IN, 'action', 'send_goal', '/run', CAPTURE, '{poses_per_sphere: 200}'],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        while not process.stdout.readline().startswith('Goal accepted'):
            assert process.poll() is None
        process.send_signal(number)
        output, _ = process.communicate(timeout=10)
    assert output.endswith('Canceling goal...\nGoal canceled.\n')
    assert process.returncode == number
    assert peer.stdout.readline() == 'cancelled\n'


def test_parameters_are_listed_read_and_set(ros2, peer) -> None:
    assert '  rate\n' in ros2('param', 'list', '/peer').stdout
    assert ros2('param', 'get', '/peer', 'rate').stdout == 'Double value is: 5.0\n'
    assert ros2('param', 'set', '/peer', 'rate', '7.5').stdout == 'Set parameter successful\n'
    assert ros2('param', 'get', '--hide-type', 'peer', 'rate').stdout == '7.5\n'


def test_a_parameter_of_another_type_is_refused(ros2, peer) -> None:
    refused = ros2('param', 'set', '/peer', 'rate', 'fast')
    assert refused.returncode == 1
    assert refused.stderr.startswith('Setting parameter failed: ')


def test_parameters_that_are_not_there_are_refused(ros2, peer) -> None:
    assert ros2('param', 'get', '/peer', 'speed').stderr.startswith('Parameter not set')
    assert 'did you mean rate' in ros2('param', 'get', '/peer', 'rat').stderr
    nobody = ros2('param', 'get', '/nobody', 'x', '--timeout', '3').stderr
    assert nobody == 'Node not found; there is /peer\n'


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A bag as another program writes it: three texts half a second apart."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text = store.types['std_msgs/msg/String']
    with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection('/replayed', text.__msgtype__, typestore=store)
        for number in range(3):
            data = store.serialize_cdr(text(f'text {number}'), text.__msgtype__)
            writer.write(topic, 10**18 + number * 500_000_000, data)
    return tmp_path / 'bag'


def test_bag_info_says_what_is_in_a_bag(ros2, bag: Path) -> None:
    lines = ros2('bag', 'info', str(bag)).stdout.splitlines()
    assert 'Duration:          1.000000001s' in lines or 'Duration:          1.000000000s' in lines
    assert 'Messages:          3' in lines
    assert 'Storage id:        mcap' in lines
    assert (
        'Topic information: Topic: /replayed | Type: std_msgs/msg/String | Count: 3 | '
        'Serialization Format: cdr'
    ) in lines


def test_bag_info_says_what_is_wrong_in_one_line(ros2, tmp_path: Path) -> None:
    missing = ros2('bag', 'info', str(tmp_path / 'nothing'))
    assert (missing.returncode, missing.stderr.count('\n')) == (1, 1)
    assert 'does not exist' in missing.stderr
    (tmp_path / 'metadata.yaml').write_text('something else')
    assert 'rosbag2_bagfile_information' in ros2('bag', 'info', str(tmp_path)).stderr


def test_bag_play_publishes_what_was_recorded(environment, ros2, bag: Path) -> None:
    echo = [
        STAND_IN,
        'topic',
        'echo',
        '/replayed',
        'std_msgs/msg/String',
        '--qos-reliability',
        'reliable',
        '--field',
        'data',
    ]
    with subprocess.Popen(echo, env=environment, stdout=subprocess.PIPE, text=True) as listener:
        time.sleep(1.5)
        assert ros2('bag', 'play', str(bag), '--rate', '2').returncode == 0
        heard = [listener.stdout.readline().strip() for _ in range(6)]
        listener.send_signal(signal.SIGINT)
    assert heard == ['text 0', '---', 'text 1', '---', 'text 2', '---']


def test_packages_and_their_executables_are_found(ros2) -> None:
    assert {'calib_solver', 'rclpy'} <= set(ros2('pkg', 'list').stdout.split())
    assert ros2('pkg', 'executables', 'calib_bringup').stdout == 'calib_bringup demo\n'
    prefix = Path(ros2('pkg', 'prefix', 'calib_solver').stdout.strip())
    assert (prefix / 'lib' / 'calib_solver' / 'identify').is_file()


def test_interface_show_puts_nested_messages_below_their_field(ros2) -> None:
    shown = ros2('interface', 'show', 'calib_interfaces/msg/ProbingPose', '--no-comments').stdout
    assert shown.splitlines()[:5] == [
        'std_msgs/Header header',
        '\tbuiltin_interfaces/Time stamp',
        '\t\tint32 sec',
        '\t\tuint32 nanosec',
        '\tstring frame_id',
    ]


@pytest.mark.parametrize('words', [(), ('--help',), ('topic',), ('service', 'call', '-h')])
def test_help_is_given_at_every_level(ros2, words: tuple[str, ...]) -> None:
    result = ros2(*words)
    assert result.returncode == 0
    assert result.stdout.startswith('usage: ros2')
    assert 'example' in result.stdout or '<' in result.stdout


def test_every_verb_has_an_example_of_itself(environment) -> None:
    script = (
        'import pkgutil, standin.verbs as verbs\n'
        'for found in pkgutil.walk_packages(verbs.__path__, "standin.verbs."):\n'
        '    if not found.ispkg:\n'
        '        verb = __import__(found.name, fromlist=["EXAMPLE"])\n'
        '        words = found.name.removeprefix("standin.verbs.").replace(".", " ")\n'
        '        print(found.name, verb.EXAMPLE.startswith("ros2 " + words))\n'
    )
    told = subprocess.run(
        [sys.executable, '-c', script],
        cwd=STAND_IN.parent,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
        timeout=30,
    ).stdout
    assert told.count('True') >= 19
    assert 'False' not in told


def test_an_unknown_verb_is_refused_with_the_choices(ros2) -> None:
    result = ros2('topic', 'shout')
    assert result.returncode == 2
    assert "'shout'" in result.stderr
    assert 'echo' in result.stderr
    assert 'did you mean service?' in ros2('servise', 'list').stderr
    assert 'ros2 run calib_bringup demo' in ros2('launch', 'calib_bringup').stderr
