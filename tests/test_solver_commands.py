# SPDX-License-Identifier: Apache-2.0
"""`identify` and `evaluate` as a user meets them: real processes after `source env.bash`."""

from __future__ import annotations

import json
import re
import resource
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

import result_schema
from simulated_calibration import active, kr5, simulate

from calib_model.bags import (
    BagWriter,
    write_measurement,
)
from calib_model.descriptions import arm_yaml

TIMEOUT = 30
FILES = ('result.json', 'arm.yaml', 'probe.yaml', 'arm.urdf')
pytestmark = [pytest.mark.system, pytest.mark.timeout(120)]


@pytest.fixture(scope='module')
def environment():
    """What a shell that has sourced env.bash passes on."""
    command = f'source {ROOT}/env.bash && env -0'
    listing = subprocess.run(['bash', '-c', command], check=True, capture_output=True, text=True)
    return dict(entry.split('=', 1) for entry in listing.stdout.split('\0') if entry)


@pytest.fixture(scope='module')
def ros2_run(environment):
    """`ros2 run calib_solver ...`, with keywords of subprocess.run."""

    ros2 = shutil.which('ros2', path=environment['PATH'])

    def run(*words, **keywords):
        return subprocess.run(
            [ros2, 'run', 'calib_solver', *map(str, words)],
            env=environment,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            check=False,
            **keywords,
        )

    return run


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """Bags and descriptions, good and bad, by name."""
    folder = tmp_path_factory.mktemp('files')
    measured = simulate(kr5(), active(), 91, noise=5e-5, poses=12).measured
    seen = measured.poses.location < 5
    write_measurement(folder / 'bag', replace(measured, poses=measured.poses.take(seen)))
    write_measurement(folder / 'test', replace(measured, poses=measured.poses.take(~seen)))
    with BagWriter(folder / 'no_topics'):
        pass
    (folder / 'no_bag').mkdir()
    (folder / 'no_bag.mcap').write_bytes(b'not an MCAP file at all')
    text = arm_yaml(measured.arm)
    (folder / 'lacks_joints.yaml').write_text(text.split('joints:')[0])
    (folder / 'lacks_alpha.yaml').write_text(text.replace('alpha:', 'angle:', 1))
    short = replace(measured.arm, joints=measured.arm.joints[:5])
    (folder / 'five_joints.yaml').write_text(arm_yaml(short))
    (folder / 'taken').write_text('mine')
    return folder


def one_line(done, *said):
    """Exit code 2, nothing on stdout, one line on stderr with all of `said`."""
    assert done.returncode == 2, done.stderr
    assert done.stdout == ''
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert 'Traceback' not in done.stderr
    for part in said:
        assert part in done.stderr


def test_identify_writes_what_the_contract_lists_and_prints_the_table(ros2_run, files, tmp_path):
    output = tmp_path / 'out'
    done = ros2_run('identify', files / 'bag', '--test', files / 'test', '--output', output)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ''
    for word in ('initial', 'identified', 'held-out', 'distance error', '2 sigma', 'converged'):
        assert word in done.stdout
    assert {path.name for path in output.iterdir()} >= set(FILES)
    text = (output / 'result.json').read_text()
    record = json.loads(text, parse_constant=result_schema.refuse_constant)
    result_schema.result(record)
    quality = record['quality']
    assert quality['identified']['phi'] < quality['initial']['phi'] / 100
    judged = ros2_run(
        'evaluate', files / 'test', '--arm', output / 'arm.yaml', '--probe', output / 'probe.yaml'
    )
    assert judged.returncode == 0, judged.stderr
    found = json.loads(judged.stdout, parse_constant=result_schema.refuse_constant)
    result_schema.quality(found, {'spheres'})
    assert {key: found[key] for key in quality['test']} == quality['test']


def test_two_bags_and_options_in_any_order_make_one_calibration(ros2_run, files, tmp_path):
    done = ros2_run(
        'identify',
        '--fix',
        'd*',
        files / 'bag',
        files / 'test',
        '--objective',
        'position',
        '--prior',
        'none',
        '--output',
        tmp_path,
    )
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / 'result.json').read_text())
    assert record['objective'] == 'position'
    assert len({sphere['location'] for sphere in record['spheres']}) == 5
    assert not any(p['free'] for p in record['parameters'] if p['name'].startswith('d'))


def test_without_an_output_nothing_is_written(ros2_run, files, tmp_path):
    done = ros2_run('identify', files / 'bag', cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_report_s_figures_are_drawn_as_pictures_where_they_are_asked_for(
    ros2_run, files, tmp_path
):
    done = ros2_run(
        'identify',
        files / 'bag',
        '--test',
        files / 'test',
        '--figures',
        tmp_path / 'pictures',
        '--output',
        tmp_path / 'out',
    )
    assert done.returncode == 0, done.stderr
    report = (tmp_path / 'out' / 'report.html').read_text()
    drawn = sorted((tmp_path / 'pictures').iterdir())
    titles = re.findall(r'<figure[^>]*><figcaption><b>(.*?)</b>', report)  # one is on page 1, too
    assert len(drawn) == len(set(titles)) + 1
    assert all(path.read_bytes().startswith(b'\x89PNG') for path in drawn)
    assert (tmp_path / 'pictures' / 'before_and_after.png') in drawn
    one_line(ros2_run('identify', files / 'bag', '--figures', files / 'taken'), 'taken')


BAD = {
    'a bag that is not there': (['{}/nothing'], 'nothing: no such bag'),
    'a name that no file can have': (['a' * 300], 'no such bag'),
    'a folder without a bag': (['{}/no_bag'], 'no_bag: no .mcap file'),
    'a file that is no bag': (['{}/no_bag.mcap'], 'no_bag.mcap'),
    'a bag without the topics': (['{}/no_topics'], 'no_topics', '/capture/poses'),
    'a YAML with a missing key': (
        ['{}/bag', '--arm', '{}/lacks_joints.yaml'],
        'lacks_joints.yaml',
        "missing key 'joints'",
    ),
    'a YAML with a missing key in a joint': (
        ['{}/bag', '--arm', '{}/lacks_alpha.yaml'],
        "joints[1]: missing key 'alpha'",
    ),
    'a YAML that is not there': (['{}/bag', '--gauge', '{}/no.yaml'], 'no.yaml: cannot be read'),
    'a YAML of something else': (['{}/bag', '--probe', '{}/five_joints.yaml'], 'five_joints.yaml'),
    'an arm of other joints': (['{}/bag', '--arm', '{}/five_joints.yaml'], 'has 5 joints'),
    'an unknown option': (['{}/bag', '--iterations', '3'], '--iterations', '--help'),
    'an option without its value': (['{}/bag', '--arm'], '--arm', '--help'),
    'no bag': ([], 'BAG', '--help'),
}
BAD_FOR_IDENTIFY = {
    'an unknown objective': (['{}/bag', '--objective', 'eq_11'], 'eq_11', 'distance, position'),
    'a file as the output': (['{}/bag', '--output', '{}/taken'], 'taken: results cannot be'),
    'an output below a file': (['{}/bag', '--output', '{}/taken/x'], 'taken/x: results cannot be'),
    'a held-out bag that is not there': (['{}/bag', '--test', '{}/nothing'], 'no such bag'),
    'a pattern of no parameter': (['{}/bag', '--fix', 'q*'], "no parameter is called 'q*'"),
    'a prior that is none': (['{}/bag', '--prior', '{}/no.yaml'], 'no.yaml: cannot be read'),
    'a prior below zero': (['{}/bag', '--prior=-1'], 'strength'),
}


def filled(words, files):
    return [word.replace('{}', str(files)) for word in words]


@pytest.mark.parametrize('command', ['identify', 'evaluate'])
@pytest.mark.parametrize('case', BAD)
def test_bad_input_is_one_line_and_exit_code_2(ros2_run, files, command, case):
    words, *said = BAD[case]
    one_line(ros2_run(command, *filled(words, files)), *said)


@pytest.mark.parametrize('case', BAD_FOR_IDENTIFY)
def test_options_of_identify_that_cannot_be_used_are_one_line(ros2_run, files, case):
    words, *said = BAD_FOR_IDENTIFY[case]
    one_line(ros2_run('identify', *filled(words, files)), *said)
    assert (files / 'taken').read_text() == 'mine'


def test_a_disk_without_space_leaves_what_was_there(ros2_run, files, tmp_path):
    """A limit on the size of files stands for a full disk; it holds for this process alone."""
    for name in FILES:
        (tmp_path / name).write_text('before')

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (500, 500))

    done = ros2_run('identify', files / 'bag', '--output', tmp_path, preexec_fn=limited)
    one_line(done, f'{tmp_path}: results cannot be written')
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)
    assert {(tmp_path / name).read_text() for name in FILES} == {'before'}


def test_a_reader_that_goes_away_is_no_error(environment, files):
    command = f'set -o pipefail; ros2 run calib_solver evaluate {files}/bag | head -n 1'
    done = subprocess.run(
        ['bash', '-c', command],
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert done.returncode == 0
    assert (done.stdout, done.stderr) == ('{\n', '')


@pytest.mark.parametrize('command', ['identify', 'evaluate'])
def test_help_shows_an_example(ros2_run, command):
    done = ros2_run(command, '--help')
    assert done.returncode == 0
    assert f'ros2 run calib_solver {command}' in done.stdout
