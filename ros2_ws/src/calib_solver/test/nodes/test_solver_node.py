# SPDX-License-Identifier: Apache-2.0
"""The solver node in a process of its own, asked over DDS."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip('rclpy')
pytest.importorskip('calib_interfaces.srv')

from calib_interfaces.srv import Compare, Compensate, Evaluate, FitProbe, Identify, Verify
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from simulated_calibration import active, kr5, simulate
from simulated_points import tracked
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from calib_bringup.domains import held_domain
from calib_model.bags import (
    BagWriter,
    read_measurement,
    write_measurement,
    write_points,
)
from calib_model.nodes import qos_of
from calib_model.topics import SOLVER_MARKERS
from calib_model.urdf import arm_urdf
from calib_solver.acceptance import compare, verify
from calib_solver.calibration import Sources
from calib_solver.commands.compensate import main as compensate
from calib_solver.commands.identify import run

DOMAIN = held_domain()
DEMO = Path(__file__).resolve().parents[5] / 'bags' / 'demo' / 'identification'
TIMEOUT = 60.0
pytestmark = [pytest.mark.system, pytest.mark.timeout(180)]


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Bags and descriptions, good and bad, by name."""
    folder = tmp_path_factory.mktemp('node')
    measured = simulate(kr5(), active(), 81, noise=5e-5, poses=12).measured
    seen = measured.poses.location < 5
    write_measurement(folder / 'bag', replace(measured, poses=measured.poses.take(seen)))
    write_measurement(folder / 'test', replace(measured, poses=measured.poses.take(~seen)))
    with BagWriter(folder / 'no_topics'):
        pass
    (folder / 'bad.yaml').write_text('name: arm\nbase_frame: base\nflange_frame: tool0\n')
    (folder / 'taken').write_text('mine')
    return folder


@pytest.fixture(scope='module')
def node():
    """The process; it must be alive until the last call is answered, and end on Ctrl-C."""
    environment = {
        **os.environ,
        'ROS_DOMAIN_ID': str(DOMAIN),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
    }
    process = subprocess.Popen(
        [sys.executable, '-m', 'calib_solver.nodes.solver_node'],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
        assert process.poll() is None, 'the node ended before it was told to'
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=TIMEOUT)[1]
        assert process.returncode == 0
        assert 'Traceback' not in said
    finally:
        process.kill()
        process.communicate()


@pytest.fixture(scope='module')
def ask(node):
    """Calls a service of the node and waits for its answer."""
    context = rclpy.Context()
    previous = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(context=context, domain_id=DOMAIN)
    asker = rclpy.create_node('asker', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(asker)
    kinds = {
        Identify: 'identify',
        FitProbe: 'fit_probe',
        Evaluate: 'evaluate',
        Compensate: 'compensate',
        Verify: 'verify',
        Compare: 'compare',
        Trigger: 'solver/cancel',
    }
    clients = {kind: asker.create_client(kind, name) for kind, name in kinds.items()}

    def wait(done, what):
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, f'{what} did not come'
            executor.spin_once(timeout_sec=0.02)

    def call(kind, **request):
        client = clients[kind]
        wait(client.service_is_ready, f'service {kinds[kind]}')
        if request.pop('at_once', False):
            return client.call_async(kind.Request(**request))
        future = client.call_async(kind.Request(**request))
        wait(future.done, f'answer of {kinds[kind]}')
        return future.result()

    call.wait, call.node = wait, asker
    yield call
    executor.shutdown()
    asker.destroy_node()
    rclpy.shutdown(context=context)
    if previous is None:
        del os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']
    else:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = previous


def same(message, record, where=''):
    """Every value of a record is in the message's field of that name; null is NaN or nothing."""
    for name, value in record.items():
        place = f'{where}.{name}'
        if name in ('by_location', 'by_joint', 'convention', 'standards'):
            continue  # in the file only
        field = getattr(message, name.lower())
        if isinstance(value, dict):
            same(field, value, place)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            assert len(field) == len(value), place
            for one, row in zip(field, value, strict=True):
                same(one, row, place)
        elif value is None and hasattr(field, 'get_fields_and_field_types'):
            assert field == type(field)(), place
        elif value is None:
            assert not field or math.isnan(field), place
        elif isinstance(value, list):
            expected = [math.nan if v is None else v for v in value]
            np.testing.assert_array_equal(list(field), expected, place)
        else:
            assert field == value, place


def test_the_message_names_what_is_wrong_with_a_measurement(ask, tmp_path):
    right = read_measurement(DEMO)
    joints = np.array(right.poses.joints)
    joints[:, 1] *= -1
    poses = replace(right.poses, joints=joints)
    write_measurement(tmp_path / 'reversed', replace(right, poses=poses))
    answer = ask(Identify, bag=str(tmp_path / 'reversed'))
    assert answer.success, answer.message
    assert 'warning: the poses would fit' in answer.message
    assert 'joint joint_a2 counted the other way' in answer.message
    assert len(answer.message) <= 1100 and '\n' not in answer.message
    assert all(line in answer.message for line in answer.warnings[:1])


def test_identify_answers_what_the_command_writes(ask, files, tmp_path):
    bag, test = str(files / 'bag'), str(files / 'test')
    answer = ask(Identify, bag=bag, test=test, output=str(tmp_path / 'node'))
    assert answer.success, answer.message
    record = run([bag, '--test', test, '--output', str(tmp_path / 'command')]).record
    for written in ((tmp_path / 'node' / 'result.json').read_text(), json.dumps(record)):
        record = json.loads(written)
        record['solver'].pop('seconds')
        quality = record.pop('quality')
        record.pop('schema')
        record.pop('files', None)
        tried = record.pop('joint_errors')
        assert answer.has_joint_errors and answer.joint_errors.offered == tried['offered']
        left_out = quality.pop('left_out')
        assert answer.has_left_out and answer.left_out.folds == left_out['folds']
        assert answer.left_out.position_rms == left_out['position']['rms']
        assert record.pop('correction') is None and not answer.has_correction
        same(answer, record)
        same(answer.initial, quality['initial'])
        same(answer.identified, quality['identified'])
        same(answer.test, quality['test'])
        same(answer.test_initial, quality['test_initial'])
    assert answer.has_test
    assert answer.has_probe_fit
    assert answer.message.startswith('converged') and 'warning' not in answer.message
    assert sorted(answer.written) == sorted(map(str, (tmp_path / 'node').iterdir()))
    assert answer.identified.distance.count == 24
    assert answer.identified.phi < answer.initial.phi / 100


def test_measured_points_are_identified_evaluated_and_verified(ask, tmp_path):
    bag, output = str(tmp_path / 'points'), str(tmp_path / 'tracked')
    write_points(bag, tracked(83, 60, 2, 2, True, 4e-5, 9e-5).measured)
    answer = ask(Identify, bag=bag, output=output, correction='harmonic', quick=True)
    assert answer.success, answer.message
    assert answer.objective == 'position'
    assert answer.correction.has_quality
    assert answer.correction.identified.position.count == 60
    assert math.isnan(answer.correction.gain.two_sigma_before)
    assert [one.target for one in answer.targets] == ['1', '2']
    assert all(one.has_rotation for one in answer.targets)
    assert [one.station for one in answer.stations] == [1, 2]
    assert answer.identified.position.count == answer.identified.orientation.count == 60
    assert answer.identified.position.rms < 1e-4 < answer.initial.position.rms
    assert math.isnan(answer.identified.distance.rms)
    judged = ask(Evaluate, bag=bag, arm=f'{output}/arm.yaml')
    assert judged.success, judged.message
    assert judged.quality.position.rms == pytest.approx(answer.identified.position.rms, rel=1e-2)
    verified = ask(Verify, bag=bag, result=output)
    assert verified.success, verified.message
    assert verified.verdict == 'within'


def told(record):
    """A record as the message tells it: `quality` of both bags in fields of their own."""
    of_both = record.pop('quality')
    return record, of_both or {'identified': None, 'test': None}


def test_what_goes_beyond_d_h_is_answered_as_it_is_written(ask, files, tmp_path):
    bag, test, output = str(files / 'bag'), str(files / 'test'), tmp_path / 'node'
    urdf = tmp_path / 'kr5.urdf'
    urdf.write_text(arm_urdf(kr5()))
    answer = ask(
        Identify,
        bag=bag,
        test=test,
        output=str(output),
        correction='harmonic',
        joint_errors='encoder',
        urdf=str(urdf),
    )
    assert answer.success, answer.message
    record = json.loads((output / 'result.json').read_text())
    assert answer.has_joint_errors
    errors = record['joint_errors']
    for one in errors['tried']:
        one['gain'] = {key: one.pop(key) for key in sorted(one.keys() - {'kind', 'identified'})}
    assert [one['kind'] for one in errors['tried']] == ['encoder']
    same(answer.joint_errors, errors)
    assert answer.has_correction
    correction, of_both = told(record['correction'])
    same(answer.correction, correction)
    assert answer.correction.has_quality and answer.correction.has_test
    same(answer.correction.identified, of_both['identified'])
    same(answer.correction.test, of_both['test'])
    assert {str(output / 'robot.urdf'), str(output / 'correction.yaml')} <= set(answer.written)
    judged = ask(
        Evaluate,
        bag=test,
        arm=str(output / 'arm.yaml'),
        probe=str(output / 'probe.yaml'),
        correction=str(output / 'correction.yaml'),
    )
    assert judged.quality.phi == pytest.approx(of_both['test']['phi'])
    refused = ask(Identify, bag=bag, urdf=str(urdf))
    assert not refused.success
    assert 'name a folder' in refused.message


def test_repetitions_and_a_chosen_prior_are_those_of_the_command(ask, files):
    bag = str(files / 'bag')
    answer = ask(Identify, bag=bag, prior='auto', monte_carlo=3, seed=4)
    assert answer.success, answer.message
    record = run([bag, '--prior', 'auto', '--monte-carlo', '3', '--seed', '4']).record
    record['resampling']['monte_carlo'].pop('seconds')
    assert answer.has_resampling
    assert answer.resampling.monte_carlo.repetitions == 3
    same(answer.resampling, record['resampling'])
    same(answer.diagnostics, record['diagnostics'])


def test_options_of_a_request_are_those_of_the_command(ask, files):
    bag = str(files / 'bag')
    answer = ask(Identify, bag=bag, objective='position', fix=['d*'], prior='none')
    done = run([bag, '--objective', 'position', '--fix', 'd*', '--prior', 'none'])
    assert answer.success, answer.message
    assert answer.objective == 'position'
    assert not answer.has_test
    free = {p.name: p.free for p in answer.parameters}
    assert not any(free[f'd{i}'] for i in range(1, 7))
    assert answer.solver.phi_final == done.record['solver']['phi_final']


def test_a_bag_of_raw_topics_is_identified_like_one_with_poses(ask):
    bag = str(DEMO)
    answer = ask(Identify, bag=bag, raw=True, spheres=[1, 6, 10, 14])
    assert answer.success, answer.message
    words = [bag, '--raw', '--spheres', '1', '6', '10', '14']
    same(answer.identified, run(words).record['quality']['identified'])
    # the bag's own poses were interpolated, those from raw topics are averaged: it rounds otherwise
    expected = run([bag]).record['quality']['identified']['phi']
    assert answer.identified.phi == pytest.approx(expected, rel=1e-10)
    assert answer.notes[-1] == 'spheres 1 6 10 14, by their distances'
    refused = ask(Identify, bag=bag, raw=True, joint_states='/axes')
    assert not refused.success
    assert refused.message.endswith('but on /joint_states: say which with --joint-states')


def test_fit_probe_and_evaluate_answer_with_figures(ask, files, tmp_path):
    bag = str(files / 'bag')
    fitted = ask(FitProbe, bag=bag, output=str(tmp_path))
    assert fitted.success, fitted.message
    assert list(fitted.written) == [str(tmp_path / 'probe.yaml')]
    assert fitted.probe_fit.poses == 4 * 4 * 12
    assert np.isfinite(fitted.standard_uncertainty).all()
    before = ask(Evaluate, bag=bag)
    after = ask(Evaluate, bag=bag, probe=str(tmp_path / 'probe.yaml'))
    assert before.success
    assert after.success
    assert len(before.spheres) == 16
    assert 0 < after.quality.phi < before.quality.phi


def test_compensate_answers_what_the_command_writes(ask, files, tmp_path):
    result, table = tmp_path / 'result', tmp_path / 'targets.csv'
    run([str(files / 'bag'), '--output', str(result)])
    table.write_text('x,y,z\n0.45,0.1,0.4\n0.4,-0.2,0.3\n')
    written = tmp_path / 'command.csv', tmp_path / 'node.csv'
    assert compensate([str(result), str(table), str(written[0])]) == 0
    answer = ask(Compensate, result=str(result), table=str(table), output=str(written[1]))
    assert answer.success, answer.message
    assert written[0].read_text() == written[1].read_text()
    assert list(answer.written) == [str(written[1])]
    rows = [0.45, 0.1, 0.4, 0.4, -0.2, 0.3]
    again = ask(Compensate, result=str(result), position=rows)
    assert again.rows == 2
    assert list(again.joint_command) == list(answer.joint_command)
    assert 0 < again.miss_mean <= again.miss_max < 0.01
    assert 0 < again.change_max < 0.1
    assert again.message.startswith('2 targets: the nominal commands would miss by')
    for request, said in (
        ({'result': str(tmp_path), 'position': rows}, 'arm.yaml: cannot be read'),
        ({'result': str(result)}, 'no table, no position and no joint_position given'),
        ({'result': str(result), 'position': [9.0, 9.0, 9.0]}, 'row 1: kr5 does not get to'),
        ({'result': str(result), 'position': rows, 'tool': 'hand'}, "no tool 'hand'"),
    ):
        refused = ask(Compensate, **request)
        assert refused.success is False
        assert said in refused.message


def test_verify_and_compare_answer_what_the_commands_say(ask, files, tmp_path):
    result = tmp_path / 'result'
    run([str(files / 'bag'), '--output', str(result), '--quick'])
    found = verify(Sources((str(files / 'test'),)), str(result), more={'distance_max': 1e-9})
    request = {'bag': str(files / 'test'), 'result': str(result), 'output': str(tmp_path / 'page')}
    answer = ask(Verify, **request, limit_names=['distance_max'], limit_values=[1e-9])
    record = found.record()
    assert answer.success, answer.message
    assert answer.verdict == record['verdict'] == 'failed'
    same(answer.quality, record['quality'])
    same(answer.limits[0], record['limits'][0])
    assert answer.position_bound == record['stated']['position']['bound']
    assert list(answer.written) == [str(tmp_path / 'page' / 'verification.html')]
    again = ask(Compare, results=[str(result), str(result)], output=str(tmp_path / 'page'))
    assert again.verdict == 'no change beyond uncertainty'
    step = compare([str(result), str(result)]).record()['steps'][0]
    assert len(again.changes[0].parameters) == len(step['parameters'])
    same(again.changes[0].parameters[0], step['parameters'][0])
    for kind, wrong, said in (
        (Verify, {**request, 'limit_names': ['distance_most'], 'limit_values': [1.0]}, 'unknown'),
        (Verify, {**request, 'limit_names': ['distance_max']}, 'limit_values'),
        (Verify, {**request, 'result': str(files)}, 'arm.yaml: cannot be read'),
        (Compare, {'results': [str(result)]}, 'two results or more'),
    ):
        refused = ask(kind, **wrong)
        assert refused.success is False
        assert said in refused.message


BAD = {
    'a path that is not there': ({'bag': '{files}/nothing'}, 'nothing: no such bag'),
    'a path no file can have': ({'bag': 'a' * 5000}, 'no such bag'),
    'no path at all': ({}, 'no bag given'),
    'a bag without the topics': ({'bag': '{files}/no_topics'}, '/capture/poses'),
    'a YAML with a missing key': (
        {'bag': '{files}/bag', 'arm': '{files}/bad.yaml'},
        "bad.yaml: missing key 'joints'",
    ),
    'a YAML that is not there': ({'bag': '{files}/bag', 'gauge': '/no.yaml'}, '/no.yaml'),
    'a file that is no bag': ({'bag': '{files}/taken'}, 'taken'),
}


@pytest.mark.parametrize('kind', [Identify, FitProbe, Evaluate], ids=lambda k: k.__name__)
@pytest.mark.parametrize('case', BAD)
def test_bad_input_is_one_line_and_the_node_answers_the_next_call(ask, files, kind, case):
    request, said = BAD[case]
    request = {key: value.replace('{files}', str(files)) for key, value in request.items()}
    answer = ask(kind, **request)
    assert answer.success is False
    assert said in answer.message
    assert len(answer.message.splitlines()) == 1
    assert len(answer.spheres) == 0
    assert ask(Evaluate, bag=str(files / 'bag')).success


@pytest.mark.parametrize(
    ('request_fields', 'said'),
    [
        ({'objective': 'eq_11'}, "no objective 'eq_11'"),
        ({'fix': ['q*']}, "no parameter is called 'q*'"),
        ({'free': ['q*']}, "no parameter is called 'q*'"),
        ({'prior': 'weak'}, 'weak'),
        ({'prior': '-3'}, 'strength'),
        ({'test': 'no/bag'}, 'no/bag: no such bag'),
        ({'output': '{files}/taken'}, 'taken: results cannot be written'),
    ],
)
def test_options_that_cannot_be_used_are_one_line_too(ask, files, request_fields, said):
    fields = {
        key: value.replace('{files}', str(files)) if isinstance(value, str) else value
        for key, value in request_fields.items()
    }
    answer = ask(Identify, bag=str(files / 'bag'), **fields)
    assert answer.success is False
    assert said in answer.message
    assert len(answer.message.splitlines()) == 1
    assert (files / 'taken').read_text() == 'mine'


def test_calls_at_the_same_time_are_all_answered(ask, files):
    bag = str(files / 'bag')
    futures = [ask(Identify, bag=bag, at_once=True) for _ in range(4)]
    futures += [ask(Evaluate, bag=str(files / 'nothing'), at_once=True) for _ in range(2)]
    ask.wait(lambda: all(future.done() for future in futures), 'every answer')
    answers = [future.result() for future in futures]
    assert [answer.success for answer in answers] == [True] * 4 + [False] * 2
    assert len({answer.identified.phi for answer in answers[:4]}) == 1


def test_what_is_under_way_is_cancelled_or_ends_at_its_time_limit(ask, files, tmp_path):
    bag, output = str(files / 'bag'), tmp_path / 'out'
    endless = {'bag': bag, 'monte_carlo': 90_000, 'output': str(output)}
    answer = ask(Identify, **endless, time_limit=0.5)
    assert answer.success is False
    assert answer.message == 'time_limit: ended after 0.5 s, before it was done'
    assert ask(Trigger).message == 'nothing was under way'
    future = ask(Identify, **endless, at_once=True)
    ask.wait(lambda: ask(Trigger).message == '1 cancelled', 'the cancelling of one')
    ask.wait(future.done, 'the answer that it is cancelled')
    assert future.result().success is False
    assert future.result().message.startswith('cancelled: ')
    assert list(tmp_path.iterdir()) == []
    assert ask(Identify, bag=bag, quick=True, time_limit=60.0).success


def test_residuals_are_shown_after_an_identification_as_large_as_is_asked(ask, files):
    shown = []
    qos = qos_of(SOLVER_MARKERS)
    ask.node.create_subscription(MarkerArray, SOLVER_MARKERS.name, shown.append, qos)
    setter = AsyncParameterClient(ask.node, 'solver')
    ask.wait(setter.services_are_ready, 'services of parameters')

    def magnified(times):
        parameter = Parameter('magnification', value=times).to_parameter_msg()
        future = setter.set_parameters([parameter])
        ask.wait(future.done, 'answer')
        return future.result().results[0].successful

    assert magnified(100)
    assert not magnified(0)
    assert ask(Identify, bag=str(files / 'bag')).success
    ask.wait(lambda: shown and len(shown[-1].markers) == 3, 'picture')
    count = len(shown)
    assert magnified(200.0)
    ask.wait(lambda: len(shown) > count, 'larger picture')
    small, large = (
        [np.array([[p.x, p.y, p.z] for p in marker.points]) for marker in picture.markers[1:]]
        for picture in (shown[count - 1], shown[-1])
    )
    for less, more in zip(small, large, strict=True):
        assert np.allclose(more[1::2] - more[::2], 2 * (less[1::2] - less[::2]), atol=1e-12)
