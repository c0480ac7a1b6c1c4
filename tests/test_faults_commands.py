# SPDX-License-Identifier: Apache-2.0
"""Every command as somebody may call it who means no good: any option, file or stream of messages.

Each ends with exit code 0, or 2 and one line; never another exception or a warning, and never with
a result that looks surer than its poses make it.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import os
import random
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from disordered_streams import DISORDERS, disordered
from hypothesis import given, strategies as st
from mutations import ROUNDS, outcomes

from calib_bringup.domains import held_domain
from calib_model.bags import (
    BagWriter,
    read_measurement,
    write_descriptions,
    write_measurement,
)
from calib_model.descriptions import arm_yaml, gauge_yaml, parse_arm, probe_yaml
from calib_model.errors import CalibrationError
from calib_model.measurement import Measurement, ProbingSet
from calib_model.pairing import (
    HandGuidedPairing,
    HandGuidedSettings,
    JointSample,
    Pairing,
    Reading,
    SteadyPose,
    SteadySettings,
)
from calib_model.urdf import arm_urdf

pytestmark = [pytest.mark.system, pytest.mark.timeout(120 * ROUNDS)]
ROOT = Path(__file__).resolve().parents[1]
RECORDED = ROOT / 'bags' / 'demo' / 'held_out'
CONFIG = ROOT / 'ros2_ws' / 'src' / 'calib_bringup' / 'config'
VALUES = (
    'nan',
    'inf',
    '-inf',
    '-1',
    '0',
    '1e308',
    '1e400',
    '-1e-320',
    '9' * 30,
    '',
    'é\u2028',
    'x',
    '1.5',
    '2147483648',
    '18446744073709551616',
    '1e9',
    '0x10',
    '1_000',
    '\udcff',
    ' ',
    '--',
    '-',
    'None',
    '[',
    '*',
    '..',
    '/',
    '/dev/null',
    '/dev/zero',
    '/proc/self/mem',
    'y' * 5000,
    '1,2,3',
)
RAW = (
    'settle',
    'dwell',
    'max-speed',
    'max-spread',
    'joints',
    'spheres',
    'motion',
    'joint-states',
    'displacements',
)
GIVEN = ('arm', 'probe', 'gauge')
ALL_GIVEN = ('--arm', 'arm.yaml', '--probe', 'probe.yaml', '--gauge', 'gauge.yaml')
ONE_POSE = ('--locations', '1', '--spheres', '1', '--poses', '2')


@dataclass(frozen=True)
class Command:
    """A call that works, with `OUT` for something to write, and the options to try on it."""

    module: str
    words: tuple[str, ...]
    options: tuple[str, ...] = ()
    cases: int = 12
    codes: tuple[int, ...] = field(default=(0,))


COMMANDS = {
    'identify': Command(
        'calib_solver.commands.identify',
        ('bag',),
        (
            'output',
            'objective',
            'test',
            *GIVEN,
            'urdf',
            'fix',
            'free',
            'prior',
            'loss',
            'joint-errors',
            'links',
            'correction',
            'seed',
            'figures',
        ),
    ),
    'identify raw': Command('calib_solver.commands.identify', ('raw', '--raw'), RAW, 8),
    'evaluate': Command('calib_solver.commands.evaluate', ('bag',), (*GIVEN, 'correction', *RAW)),
    'compensate': Command(
        'calib_solver.commands.compensate',
        ('result', 'targets.csv', 'OUT'),
        ('tool',),
        codes=(0, 1),
    ),
    'kuka_figures': Command('calib_solver.commands.kuka_figures', ('result',), ('arm',)),
    'arm_from_urdf': Command(
        'calib_model.commands.arm_from_urdf', ('arm.urdf', 'OUT'), ('base', 'flange', 'name')
    ),
    'pair': Command(
        'calib_capture.commands.pair',
        ('raw', 'OUT'),
        (
            'placements',
            'mode',
            'settle',
            'dwell',
            'max-speed',
            'max-spread',
            'max-gap',
            'lateness',
        ),
    ),
    'pair led': Command(
        'calib_capture.commands.pair',
        ('raw', 'OUT', '--mode', 'continuous', '--placements', 'placements.yaml'),
        ('spacing', 'seated', 'max-gap', 'lateness'),
        8,
    ),
    'plan': Command(
        'calib_capture.commands.plan',
        (*ONE_POSE, '--pool', '1', '--approach', '0'),
        (*GIVEN, 'placements', 'poses', 'pool', 'cap', 'approach', 'bodies', 'seed'),
    ),
    'import_csv': Command(
        'calib_capture.commands.import_csv', ('table.csv', 'OUT', *ALL_GIVEN), GIVEN
    ),
    'recover': Command('calib_capture.commands.recover', ('bag', 'OUT'), codes=(0, 3)),
    'hand_guided': Command(
        'selfcenter_probe.commands.hand_guided',
        ('OUT', *ONE_POSE),
        (
            'probe',
            'locations',
            'spheres',
            'speed',
            'seed',
            'arm',
            'gauge',
            'placements',
            'world',
        ),
    ),
    'demo': Command('calib_bringup.demo', ('--poses', '1'), ('variant', 'output', 'seed')),
}


@pytest.fixture(scope='module')
def measured() -> Measurement:
    whole = read_measurement(ROOT / 'bags' / 'demo' / 'identification')
    return replace(whole, poses=whole.poses.take(np.arange(0, len(whole.poses), 4)))


@pytest.fixture(scope='module')
def files(measured: Measurement, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with all that a command may be given, for another one, too."""
    folder: Path = tmp_path_factory.mktemp('files')
    write_measurement(folder / 'bag', measured)
    shutil.copytree(RECORDED, folder / 'raw')
    for name, text in (
        ('arm.yaml', arm_yaml(measured.arm)),
        ('probe.yaml', probe_yaml(measured.probe)),
        ('gauge.yaml', gauge_yaml(measured.gauge)),
        ('arm.urdf', arm_urdf(measured.arm)),
        ('targets.csv', 'x,y,z\n0.3,0.1,0.4\n'),
        ('empty.yaml', ''),
        ('list.yaml', '- 1\n'),
        ('placements.yaml', (CONFIG / 'locations' / 'kr5.yaml').read_text()),
        ('links.yaml', (CONFIG / 'links' / 'kuka_kr5_sixx_r650.yaml').read_text()),
        ('bodies.yaml', (CONFIG / 'bodies' / 'kr5.yaml').read_text()),
        ('table.csv', table(measured)),
    ):
        (folder / name).write_text(text)
    odd_bags(folder, measured)
    assert said('identify', folder, 'bag', '--output', 'result')[0] == 0
    return folder


def table(measured: Measurement) -> str:
    poses = measured.poses
    rows = zip(poses.location, poses.sphere, poses.joints, poses.displacement, strict=True)
    lines = ['location,sphere,q1,q2,q3,q4,q5,q6,s1,s2,s3']
    lines += [','.join(map(str, (k, n, *q.tolist(), *s.tolist()))) for k, n, q, s in rows]
    return '\n'.join(lines) + '\n'


def odd_bags(folder: Path, measured: Measurement) -> None:
    """Bags that are none of what a command expects, or are of another arm."""
    with BagWriter(folder / 'empty'):
        pass
    with BagWriter(folder / 'described') as bag:
        write_descriptions(bag, measured.arm, measured.probe, measured.gauge, 1)
    (folder / 'loop').symlink_to(folder / 'loop')
    (folder / 'link').symlink_to(folder / 'bag')
    (folder / 'folder').mkdir()
    (folder / 'cut.mcap').write_bytes((RECORDED / 'held_out_0.mcap').read_bytes()[:100_000])
    joints = measured.poses.joints
    iiwa = parse_arm((CONFIG / 'arms' / 'kuka_lbr_iiwa14.yaml').read_text(), 'iiwa')
    for name, arm, q in (
        ('five', replace(measured.arm, joints=measured.arm.joints[:5]), joints[:, :5]),
        ('seven', iiwa, np.column_stack([joints, joints[:, 0]])),
    ):
        write_measurement(
            folder / name, replace(measured, arm=arm, poses=replace(measured.poses, joints=q))
        )


def said(name: str, folder: Path, *words: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a command called in a folder, in this process."""
    module = COMMANDS[name].module if name in COMMANDS else name
    main: Callable[[], int] = importlib.import_module(module).main
    out, err = io.StringIO(), io.StringIO()
    argv, place = sys.argv, os.getcwd()
    sys.argv = [name.split()[0], *words]
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            code = main()
    finally:
        os.chdir(place)
        sys.argv = argv
    return code, out.getvalue(), err.getvalue()


def called(name: str, folder: Path, words: list[str], out: Path) -> None:
    """Call; what is refused in one line is raised again for `outcomes` to count."""
    shutil.rmtree(out, ignore_errors=True)
    out.unlink(missing_ok=True)
    code, _, err = said(name, folder, *(str(out) if word == 'OUT' else word for word in words))
    codes = COMMANDS[name].codes if name in COMMANDS else (0,)
    assert code in (*codes, 2), (name, words, code, err)
    assert 'Traceback' not in err and 'Warning' not in err, err
    if code == 2:
        assert err.count('\n') == 1, (name, words, err)
        raise CalibrationError(err)


@pytest.mark.parametrize('name', COMMANDS)
def test_an_option_of_any_value_is_refused_or_taken(name: str, files: Path, tmp_path: Path) -> None:
    command = COMMANDS[name]

    def call(rng: random.Random) -> None:
        words = list(command.words)
        option, value = rng.choice((*command.options, 'unknown')), rng.choice(VALUES)
        if option == 'output':
            value = str(tmp_path / 'results') if value.isprintable() else value
        how = rng.choice(('joined', 'joined', 'apart', 'none', 'twice'))
        words += {
            'joined': [f'--{option}={value}'],
            'apart': [f'--{option}', value],
            'none': [f'--{option}'],
            'twice': [f'--{option}={value}'] * 2,
        }[how]
        called(name, files, words, tmp_path / 'out')

    assert outcomes(f'{name} options', command.cases, call)[1]


@pytest.mark.parametrize('name', [name for name in COMMANDS if name not in ('demo', 'plan')])
def test_any_file_in_any_place_is_refused_or_taken(name: str, files: Path, tmp_path: Path) -> None:
    command = COMMANDS[name]
    there = sorted(path.name for path in files.iterdir())
    places = [i for i, word in enumerate(command.words) if word in there]
    paths = [
        each
        for each in command.options
        if each
        in ('test', 'urdf', 'links', 'prior', 'correction', 'bodies', 'placements', 'world', *GIVEN)
    ]

    def call(rng: random.Random) -> None:
        words = list(command.words)
        if paths and (not places or rng.random() < 0.5):
            words += [f'--{rng.choice(paths)}', rng.choice(there)]
        else:
            words[rng.choice(places)] = rng.choice(there)
        called(name, files, words, tmp_path / 'out')

    assert outcomes(f'{name} files', 10, call)[1]


def test_streams_in_any_disorder_are_refused_or_paired(files: Path, tmp_path: Path) -> None:
    led = list(COMMANDS['pair led'].words[2:])
    ways: tuple[tuple[str, list[str]], ...] = (
        ('pair', ['OUT']),
        ('pair', ['OUT', '--placements', 'placements.yaml']),
        ('pair led', ['OUT', *led, '--spacing', '0.001', '--seated', '0', '--correct-clock']),
        ('identify', ['--raw']),
        ('evaluate', ['--raw', '--motion', 'led']),
    )
    numbers = iter(range(10_000_000))

    def call(rng: random.Random) -> None:
        number = next(numbers)
        bag = tmp_path / f'bag_{number}'
        first = list(DISORDERS)[number % len(DISORDERS)]
        disordered(RECORDED, bag, rng, [first, *rng.sample(list(DISORDERS), rng.randrange(2))])
        name, words = rng.choice(ways)
        called(name, files, [str(bag), *words], tmp_path / 'out')

    well, refused = outcomes('streams', 2 * len(DISORDERS), call)
    assert well > 5 and refused > 5


def test_streams_in_any_disorder_are_played(
    tmp_path: Path, files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('rclpy')
    monkeypatch.setenv('ROS_DOMAIN_ID', str(held_domain()))
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    numbers = iter(range(10_000_000))

    def call(rng: random.Random) -> None:
        bag = tmp_path / f'bag_{next(numbers)}'
        disordered(RECORDED, bag, rng, ['odd numbers', 'more joints', 'shuffled'])
        words = [str(bag), '--rate', '1e9', '--wait', '0', '--clock']
        called('calib_capture.nodes.replay_node', files, words, tmp_path / 'out')

    assert sum(outcomes('replay', 2, call))


STAMPS = st.one_of(
    st.integers(0, 40).map(lambda tick: 10_000_000 * tick),
    st.sampled_from((0, 1, 2**62)),
    st.integers(-(2**62), 2**62),
)
NUMBERS = st.one_of(st.sampled_from((0.0, 1e-3, 2e-3)), st.floats())
MESSAGES = st.lists(
    st.one_of(
        st.builds(lambda stamp, q: JointSample(stamp, np.array([q, 0.0])), STAMPS, NUMBERS),
        st.builds(
            lambda stamp, s, status: Reading(stamp, np.array([s, 0.0, 0.0]), (status, 0, 0)),
            STAMPS,
            NUMBERS,
            st.sampled_from((0, 0, 0, 1, 9)),
        ),
    ),
    max_size=60,
)


@given(MESSAGES, st.sampled_from((0.0, 0.02, 60.0)))
def test_streams_of_any_stamps_and_numbers_give_poses_of_numbers_that_were_in_them(
    messages: list[JointSample | Reading], lateness: float
) -> None:
    # what reads a stream lets no joint state through that is no number
    messages = [m for m in messages if isinstance(m, Reading) or abs(m.joints[0]) <= 1e6]
    standing = Pairing(SteadySettings(lateness=lateness))
    moving = HandGuidedPairing(HandGuidedSettings(lateness=lateness, max_gap=0.1))
    found: list[Any] = []
    for message in messages:
        for pairing in (standing, moving):
            add = pairing.add_reading if isinstance(message, Reading) else pairing.add_joints
            found += add(message)  # type: ignore[arg-type]
    found += [*standing.finish(), *moving.finish()]
    stamps = {m.stamp for m in messages if isinstance(m, Reading)}
    for each in found:
        if isinstance(each, SteadyPose) or getattr(each, 'joints', None) is not None:
            assert np.isfinite(each.joints).all()
        if isinstance(each, SteadyPose):
            assert np.isfinite(each.displacement).all() and each.readings >= 2
            assert min(stamps) <= each.stamp <= max(stamps)


def identified(folder: Path, *words: str) -> tuple[dict[str, Any], str]:
    """The record of a result, and what was printed."""
    code, out, err = said('identify', folder, *words, '--output', 'honest')
    assert code == 0, err
    return json.loads((folder / 'honest' / 'result.json').read_text()), out


def few(name: str, poses: ProbingSet) -> ProbingSet:
    """So few poses that nothing is left over to tell their noise by."""
    if name == 'one of each sphere':
        keys = np.stack([poses.location, poses.sphere])
        return poses.take(np.sort(np.unique(keys, axis=1, return_index=True)[1]))
    if name == 'the same of each sphere':
        once = few('one of each sphere', poses)
        return once.take(np.repeat(np.arange(len(once)), 5))
    return poses.take(np.arange(int(name)))


@pytest.mark.parametrize('name', ['2', '4', '5', 'one of each sphere', 'the same of each sphere'])
def test_poses_that_determine_nothing_give_no_result_that_looks_sure(
    name: str, measured: Measurement, tmp_path: Path
) -> None:
    write_measurement(tmp_path / 'few', replace(measured, poses=few(name, measured.poses)))
    record, out = identified(tmp_path, 'few')
    assert not record['solver']['converged'] and 'NOT CONVERGED' in out
    assert record['diagnostics']['position_uncertainty_rms'] > 3e-4
    assert any('is assumed for the uncertainties' in line for line in record['warnings'])
    told = [each['standard_uncertainty'] for each in record['parameters'] if each['identifiable']]
    assert all(each > 1e-5 for each in told)


def test_a_bag_that_is_given_twice_counts_once(files: Path) -> None:
    once, _ = identified(files, 'bag')
    for words in (('bag', 'bag'), ('bag', 'link')):
        twice, out = identified(files, *words)
        assert 'copies of others' in out
        assert twice['parameters'] == once['parameters']
        assert twice['diagnostics']['noise'] == once['diagnostics']['noise']


def test_what_was_identified_from_is_not_called_held_out(files: Path) -> None:
    record, _ = identified(files, 'bag', '--test', 'bag')
    count = sum(each['poses'] for each in record['spheres'])
    assert f'{count} of {count} held-out poses were identified from, too' in record['warnings'][0]
    assert not any('held-out' in line for line in identified(files, 'bag')[0]['warnings'])


@pytest.fixture(scope='module')
def environment() -> Iterator[dict[str, str]]:
    """What a shell that has sourced env.bash passes on."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    yield dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)


def run(environment: dict[str, str], *words: str, **keywords: Any) -> tuple[int, bytes, bytes]:
    """`ros2 run` within two gigabytes."""
    most = 2 << 30
    done = subprocess.run(
        [shutil.which('ros2', path=environment['PATH']) or 'ros2', 'run', *words],
        env=environment,
        timeout=60,
        check=False,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (most, most)),
        **{'stdout': subprocess.PIPE, **keywords},
    )
    return done.returncode, done.stdout, done.stderr


def test_names_that_are_no_text_are_names(
    files: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    odd = f'{tmp_path}/\udcff\x1b[2J\n'
    shutil.copytree(files / 'bag', odd)
    shutil.copy(files / 'arm.urdf', f'{odd}.urdf')
    assert run(environment, 'calib_solver', 'identify', odd, '--output', f'{odd}out')[0] == 0
    assert b'\\udcff' in Path(f'{odd}out', 'report.html').read_bytes()
    words = ('calib_model', 'arm_from_urdf', f'{odd}.urdf', f'{odd}.yaml')
    assert run(environment, *words)[0] == 0
    assert parse_arm(Path(f'{odd}.yaml').read_text(), 'odd').n == 6
    code, out, err = run(environment, 'calib_solver', 'evaluate', f'{odd}no')
    assert (code, out, err.count(b'\n')) == (2, b'', 1) and b'\x1b' not in err


def test_a_full_disk_behind_the_output_or_none_at_all_is_borne(
    files: Path, environment: dict[str, str]
) -> None:
    words = ('calib_solver', 'evaluate', str(files / 'bag'))
    with open('/dev/full', 'wb') as full:
        code, _, err = run(environment, *words, stdout=full)
    assert (code, err) == (2, b'output: No space left on device\n')
    code, _, err = run(
        {**environment, 'CALIB_THREADS': 'all'}, 'calib_solver', 'identify', str(files / 'bag')
    )
    assert (code, err.count(b'\n')) == (2, 1) and b'CALIB_THREADS' in err
