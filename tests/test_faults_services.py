# SPDX-License-Identifier: Apache-2.0
"""Requests that no client should make, to the real solver node: each is answered, none kills it."""

from __future__ import annotations

import math
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

rclpy = pytest.importorskip('rclpy')
pytest.importorskip('calib_interfaces.srv')

from calib_interfaces.srv import Compare, Compensate, Evaluate, FitProbe, Identify, Verify
from memory import high_water
from mutations import ROUNDS, dice
from rclpy.executors import SingleThreadedExecutor
from soak import note

from calib_bringup.domains import held_domain

DEMO = Path(__file__).resolve().parents[1] / 'bags' / 'demo'
DOMAIN = held_domain()
ANSWER = 30.0  # s
MOST_MEMORY = 2 << 30  # bytes
SERVICES = {
    'identify': Identify,
    'fit_probe': FitProbe,
    'evaluate': Evaluate,
    'compensate': Compensate,
    'verify': Verify,
    'compare': Compare,
}
TEXTS = (
    '',
    ' ',
    'x',
    'é\u202e\U0001f600',
    'a\nb\r\tc',
    '\x1b[2J',
    'x' * 1_000_000,
    'é' * 100_000,
    '../../../../../../etc/passwd',
    '/etc/passwd',
    '/dev/zero',
    '/dev/null',
    '/dev/stdin',
    '/proc',
    '/proc/self/mem',
    '/',
    '..',
    '.',
    '~',
    '~/x',
    ':' * 10_000,
    '$(id)',
    '`id`',
    "'; id; '",
    '*',
    '%s%n',
    '{0}',
    '-1',
    'nan',
    'inf',
    '1e308',
    'none',
    'auto',
    'http://127.0.0.1:1/x',
    'a' * 300,
    'a/' * 3000,
    '!!python/object/apply:os.system [id]',
    '/dev/fd/0',
    '[' * 10_000,
)
NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e-320, 0.0, -0.0, 1.0, 1e9)
pytestmark = [pytest.mark.system, pytest.mark.timeout(300 * ROUNDS)]


def odd_value(kind: str, rng: random.Random) -> Any:
    """A value of a field's type that is out of any range."""
    if kind.startswith('sequence<'):
        inner = kind[9:].rstrip('>').split(',')[0].strip()
        count = rng.choice((0, 1, 2, 3, 7, 1000, 100_000))
        short = [odd_value(inner, rng) for _ in range(min(count, 5))]
        values = [value if not isinstance(value, str) else value[:50] for value in short]
        return (values * (count // max(len(values), 1) + 1))[:count] if values else []
    if kind == 'string':
        return rng.choice(TEXTS)
    if kind == 'boolean':
        return rng.random() < 0.5
    if kind in ('double', 'float'):
        return rng.choice(NUMBERS)
    bits = int(kind.replace('uint', '').replace('int', ''))
    most = (1 << bits) - 1 if kind.startswith('u') else (1 << (bits - 1)) - 1
    return rng.choice((0, 1, most, most - 1, rng.randrange(most)))


def odd_request(service: type, good: dict[str, Any], rng: random.Random) -> Any:
    """A request that was good, with one field or many that are not."""
    request = service.Request(**good)
    kinds = request.get_fields_and_field_types()
    kinds.pop('scheduler', None)  # an address that nobody answers at costs its ten seconds
    if kinds.get('bootstrap'):
        kinds.pop('monte_carlo')  # a few thousand repetitions are a right that a caller has
        kinds.pop('bootstrap')
    for name in rng.sample(list(kinds), rng.choice((1, 1, 2, len(kinds)))):
        setattr(request, name, odd_value(kinds[name], rng))
    return request


@pytest.fixture(scope='module')
def node(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[subprocess.Popen, Path]]:
    """The process and its log, in a folder of its own; callers may read whatever there is."""
    folder = tmp_path_factory.mktemp('node')
    env = {**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    with (folder / 'log').open('w') as log:
        process = subprocess.Popen(
            [
                sys.executable,
                '-m',
                'calib_solver.nodes.solver_node',
                '--ros-args',
                '-p',
                'bag_folders:=[/]',
                '-p',
                f'output_folders:=[{folder}]',
            ],
            env=env,
            cwd=folder,
            stderr=log,
            stdout=log,
            stdin=subprocess.DEVNULL,
        )
    try:
        yield process, folder / 'log'
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@pytest.fixture(scope='module')
def ask(node: tuple[subprocess.Popen, Path]) -> Iterator[Callable[[str, Any], Any]]:
    """Calls a service of the node and waits for its answer."""
    previous = os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE')
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    asker = rclpy.create_node('odd_asker', context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(asker)
    clients = {name: asker.create_client(kind, name) for name, kind in SERVICES.items()}

    def call(name: str, request: Any) -> Any:
        end = time.monotonic() + ANSWER
        while not clients[name].service_is_ready():
            assert time.monotonic() < end, f'/{name} is not there'
            executor.spin_once(timeout_sec=0.05)
        future = clients[name].call_async(request)
        while not future.done():
            assert node[0].poll() is None, 'the node has ended'
            assert time.monotonic() < end, f'/{name} does not answer'
            executor.spin_once(timeout_sec=0.05)
        return future.result()

    yield call
    executor.shutdown()
    asker.destroy_node()
    rclpy.shutdown(context=context)
    if previous is None:
        del os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']
    else:
        os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = previous


def good_requests(folder: Path) -> dict[str, dict[str, Any]]:
    bag, result = {'bag': str(DEMO / 'held_out')}, str(folder / 'result')
    return {
        'identify': bag,
        'fit_probe': bag,
        'evaluate': bag,
        'compensate': {'result': result, 'position': [0.5, 0.0, 0.4]},
        'verify': {**bag, 'result': result},
        'compare': {'results': [result, f'{result}_later']},
    }


def test_odd_requests_are_answered_in_one_line_and_good_ones_as_before(
    node: tuple[subprocess.Popen, Path], ask: Callable[[str, Any], Any]
) -> None:
    process, log = node
    good = good_requests(log.parent)
    for result in good['compare']['results']:
        made = ask('identify', Identify.Request(bag=good['identify']['bag'], output=result))
        assert made.success, made.message
    before = {name: ask(name, kind.Request(**good[name])) for name, kind in SERVICES.items()}
    assert all(answer.success for answer in before.values()), before
    refused = 0
    for number in range(100 * ROUNDS):
        rng = dice('request', number)
        name = rng.choice(list(SERVICES))
        answer = ask(name, odd_request(SERVICES[name], good[name], rng))
        assert answer.message and answer.message.isprintable(), f'{number}: {answer.message!r}'
        assert len(answer.message) < 1200, f'{number}'
        refused += not answer.success
    assert refused > 50 * ROUNDS
    note(**{'damaged requests': [100 * ROUNDS - refused, refused]})
    for name, kind in SERVICES.items():
        answer = ask(name, kind.Request(**good[name]))
        assert answer.success
        for field in answer.get_fields_and_field_types():
            if field not in ('solver', 'message', 'written'):  # how long it took
                ours, theirs = (repr(getattr(one, field)) for one in (answer, before[name]))
                assert ours == theirs, f'{name}: {field}'
    assert 0 < high_water(process.pid) < MOST_MEMORY
    text = log.read_text(errors='replace')
    assert 'Traceback' not in text
    assert 'Warning:' not in text, text[text.index('Warning:') - 500 :][:1000]


@pytest.mark.parametrize('field', ['monte_carlo', 'bootstrap'])
def test_repetitions_without_end_are_refused(field: str, ask: Callable[[str, Any], Any]) -> None:
    bag = str(DEMO / 'identification')
    answer = ask('identify', Identify.Request(bag=bag, **{field: 2**32 - 1}))
    assert not answer.success
    assert '4294967295: expected 0, or 2 or more repetitions, 100000 at most' in answer.message


def test_nothing_was_written_outside_of_where_callers_may(
    node: tuple[subprocess.Popen, Path], ask: Callable[[str, Any], Any]
) -> None:
    bag = str(DEMO / 'held_out')
    for output in ('/etc/arm', '/../etc/arm', '/usr/../etc/arm', '/proc/self/cwd/../../../etc/arm'):
        answer = ask('identify', Identify.Request(bag=bag, output=output))
        assert not answer.success, output
        assert 'outside the folders open to callers' in answer.message
    assert not Path('/etc/arm').exists()
    deep = ask('identify', Identify.Request(bag=bag, output='a/' * 2500))
    assert 'File name too long' in deep.message
    assert not (node[1].parent / 'a').exists()
