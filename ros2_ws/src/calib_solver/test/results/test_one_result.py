# SPDX-License-Identifier: Apache-2.0
"""A result folder is one result: what belongs together is listed, and a mixture is refused."""

import json
import shutil
from pathlib import Path

import pytest

from calib_model.descriptions import parse_arm, read_description
from calib_model.errors import CalibrationError
from calib_model.files import refuse_mixture
from calib_model.urdf import arm_urdf
from calib_solver.calibration import Sources, fit_probe_from
from calib_solver.commands import compensate, kuka_figures
from calib_solver.commands.identify import main
from calib_solver.compensation import read_calibrated

pytestmark = pytest.mark.timeout(60)
ROOT = Path(__file__).resolve().parents[5]
DEMO = ROOT / 'bags/demo/identification'
ARM = ROOT / 'ros2_ws/src/calib_bringup/config/arms/kuka_kr5_sixx_r650.yaml'
WRITTEN = {
    'arm.yaml',
    'probe.yaml',
    'arm.urdf',
    'report.html',
    'report.json',
    'uncertainty.json',
}


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    """Two calibrations of one bag."""
    folder = tmp_path_factory.mktemp('results')
    for name, more in (('one', []), ('other', ['--fix', 'd*'])):
        assert main([str(DEMO), '--quick', '--output', str(folder / name), *more]) == 0
    return folder


@pytest.fixture
def mixed(results, tmp_path):
    """Copies the one, with a file of the other."""

    def copy(name=''):
        shutil.copytree(results / 'one', tmp_path / 'mixed')
        if name:
            shutil.copy(results / 'other' / name, tmp_path / 'mixed' / name)
        return tmp_path / 'mixed'

    return copy


def test_every_file_is_listed_and_as_it_was_written(results):
    listed = json.loads((results / 'one/result.json').read_text())['files']
    assert set(listed) == WRITTEN
    refuse_mixture(results / 'one')
    read_calibrated(results / 'one')


@pytest.mark.parametrize(
    'name', ['arm.yaml', 'probe.yaml', 'arm.urdf', 'report.html', 'report.json', 'uncertainty.json']
)
def test_a_file_of_another_calibration_is_named(mixed, name):
    with pytest.raises(CalibrationError, match=f'{name}: not the file that result.json'):
        read_calibrated(mixed(name))


def test_a_record_of_another_calibration_and_what_is_missing_are_named(mixed):
    folder = mixed('result.json')
    with pytest.raises(CalibrationError, match='not the file that result.json'):
        read_calibrated(folder)
    (folder / 'probe.yaml').unlink()
    shutil.copy(folder / 'arm.yaml', folder / 'probe.yml')
    with pytest.raises(CalibrationError):
        read_calibrated(folder)


@pytest.mark.parametrize('name', ['correction.yaml', 'robot.urdf'])
def test_what_another_run_left_there_is_named(mixed, name):
    folder = mixed()
    (folder / name).write_text('left')
    with pytest.raises(CalibrationError, match=f'{name}: of another calibration'):
        read_calibrated(folder)


def test_results_of_before_are_read_as_they_are(mixed):
    folder = mixed()
    record = json.loads((folder / 'result.json').read_text())
    del record['files']
    (folder / 'result.json').write_text(json.dumps(record))
    read_calibrated(folder)


@pytest.mark.parametrize('command', [compensate, kuka_figures])
def test_commands_refuse_it_in_one_line(mixed, command, tmp_path, capsys):
    table = tmp_path / 'targets.csv'
    table.write_text('q1,q2,q3,q4,q5,q6\n0,0,0,0,1,0\n')
    more = [str(table), str(tmp_path / 'out.csv')] if command is compensate else []
    assert command.main([str(mixed('arm.yaml')), *more]) == 2
    line = capsys.readouterr().err
    assert 'arm.yaml' in line and line.count('\n') == 1


def test_a_corrected_urdf_is_of_the_result_and_goes_with_it(tmp_path):
    urdf = tmp_path / 'own.urdf'
    urdf.write_text(arm_urdf(read_description(ARM, parse_arm)))
    out = tmp_path / 'out'
    assert main([str(DEMO), '--quick', '--output', str(out), '--urdf', str(urdf)]) == 0
    assert 'robot.urdf' in json.loads((out / 'result.json').read_text())['files']
    refuse_mixture(out)
    assert main([str(DEMO), '--quick', '--output', str(out)]) == 0
    assert not (out / 'robot.urdf').exists()
    refuse_mixture(out)


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        ('joint_a3', 'joint_x', 'its joints are'),
        ('<robot', '<xacro', ''),
        ('link name="tool0"', 'link name="tool9"', 'tool0'),
    ],
)
def test_a_urdf_that_cannot_be_corrected_is_refused_before_the_work(
    tmp_path, capsys, old, new, said
):
    urdf, out = tmp_path / 'own.urdf', tmp_path / 'out'
    urdf.write_text(arm_urdf(read_description(ARM, parse_arm)).replace(old, new))
    assert (
        main([str(DEMO), '--monte-carlo', '2000', '--output', str(out), '--urdf', str(urdf)]) == 2
    )
    line = capsys.readouterr().err
    assert said in line and line.count('\n') == 1
    assert not out.exists()


def test_eq_15_writes_into_no_result(results):
    before = {file.name: file.read_bytes() for file in (results / 'one').iterdir()}
    with pytest.raises(CalibrationError, match='name another folder'):
        fit_probe_from(Sources((str(DEMO),)), str(results / 'one'))
    assert {file.name: file.read_bytes() for file in (results / 'one').iterdir()} == before
