# SPDX-License-Identifier: Apache-2.0
"""Bags of measured points through the commands, in this process."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import result_schema
from simulated_calibration import Scene, kr5
from simulated_points import tracked

from calib_model.bags import cdr, write_measurement, write_points
from calib_model.bags.points import _quickly, _row_of
from calib_model.kinematics import Correction, JointErrors, JointTerms
from calib_model.topics import MEASURED_POINT
from calib_solver.commands import compensate, evaluate, identify, report, verify


@pytest.fixture(scope='module')
def bags(tmp_path_factory) -> dict[str, str]:
    """Three targets seen from two stations with orientations, unseen ones, and one gross error."""
    folder = tmp_path_factory.mktemp('points')
    scene = tracked(7, 150, 3, 2, True, 4e-5, 1e-4)
    position = scene.measured.points.position.copy()
    position[20] += 0.01
    spoilt = replace(scene.measured, points=replace(scene.measured.points, position=position))
    write_points(folder / 'bag', spoilt)
    write_points(folder / 'test', tracked(8, 40, 3, 2, True, 4e-5, 1e-4, world=7).measured)
    return {name: str(folder / name) for name in ('bag', 'test')}


@pytest.fixture(scope='module')
def output(bags, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('result') / 'out'
    more = ['--monte-carlo', '2', '--bootstrap', '2', '--output', str(folder)]
    assert identify.main([bags['bag'], '--test', bags['test'], *more]) == 0
    return folder


def test_the_result_is_as_the_contract_lists_it(output: Path) -> None:
    text = (output / 'result.json').read_text()
    record = json.loads(text, parse_constant=result_schema.refuse_constant)
    result_schema.point_result(record, oriented=True)
    assert [one['target'] for one in record['targets']] == ['1', '2', '3']
    assert [one['station'] for one in record['stations']] == [1, 2]
    assert [one['pose'] for one in record['rejected']] == [21]
    assert record['quality']['test']['position']['mean'] < 1.2e-4
    assert record['quality']['test_initial']['position']['mean'] > 5e-4
    assert record['solver']['converged']


def test_the_report_speaks_of_targets_and_stations(output: Path) -> None:
    page = (output / 'report.html').read_text()
    for words in (
        'Targets and stations',
        'Points left out',
        'Turned by',
        'Monte Carlo',
        'Bootstrap over points',
    ):
        assert words in page
    for words in ('sphere', 'gauge', 'certificate'):
        assert words not in page.lower().partition('inputs and versions')[0]


def test_the_report_is_made_anew_with_what_is_known_of_the_tracker(
    output: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(output, tmp_path / 'signed')
    info = tmp_path / 'info.yaml'
    info.write_text('number: T-4\nserials: {tracker: "99"}\nlimits: {position_max: 1.0e-6}\n')
    assert report.main([str(folder), '--info', str(info)]) == 0
    page = (folder / 'report.html').read_text()
    largest = json.loads((folder / 'result.json').read_text())['quality']['test']['position']['max']
    for words in (
        'Calibration report T-4',
        '2 stations, serial 99',
        'Failed: 0 of 1 limits kept, judged on held-out points.',
        f'<b>{1e3 * largest:.4f} mm</b>',
    ):
        assert words in page


@pytest.mark.slow
def test_the_figures_are_drawn(bags, tmp_path: Path) -> None:
    words = [bags['test'], '--quick', '--figures', str(tmp_path / 'drawn')]
    assert identify.main(words) == 0
    drawn = {path.stem: path.read_bytes() for path in (tmp_path / 'drawn').glob('*.png')}
    clouds = {f'residuals_{axes}' for axes in ('xy', 'xz', 'yz')}
    assert drawn.keys() == {'before_and_after', 'convergence', *clouds}
    assert all(content.startswith(b'\x89PNG') and len(content) > 4000 for content in drawn.values())


@pytest.fixture(scope='module')
def corrected(tmp_path_factory) -> Path:
    """An arm whose encoders sit eccentric, seen from two stations, with the correction of eq. 12;
    beside it new points of one of them."""
    folder = tmp_path_factory.mktemp('eccentric')
    values = 4e-4 * np.random.default_rng(9).normal(size=(4, 6))
    encoders = Correction(kr5().joint_names, JointErrors(JointTerms(2), values))
    noise = {'noise': 2e-5, 'correction': encoders}
    write_points(folder / 'bag', tracked(61, 160, 1, 2, **noise).measured)
    write_points(folder / 'new', tracked(62, 60, 1, 2, world=61, **noise).measured)
    words = [str(folder / 'bag'), '--test', str(folder / 'new'), '--joint-errors', 'none']
    words += ['--correction', 'auto', '--output', str(folder / 'out')]
    assert identify.main(words) == 0
    return folder


@pytest.mark.slow
def test_what_eq_12_corrects_is_in_the_result_and_the_report(corrected: Path) -> None:
    record = json.loads((corrected / 'out' / 'result.json').read_text())
    result_schema.point_result(record, oriented=False)
    before, after = record['quality']['test'], record['correction']['quality']['test']
    assert after['position']['rms'] < 0.8 * before['position']['rms']
    page = (corrected / 'out' / 'report.html').read_text()
    for words in ('held out, corrected', 'Correction functions (eq. 12)', 'groups of points'):
        assert words in page


def test_verify_and_evaluate_apply_what_eq_12_corrects(corrected: Path, capsys) -> None:
    record = json.loads((corrected / 'out' / 'result.json').read_text())
    told = record['correction']['quality']['test']['position']['rms']
    folder, new = str(corrected / 'out'), str(corrected / 'new')
    verify.main([new, '--result', folder, '--json'])
    verified = json.loads(capsys.readouterr().out)['quality']['position']['rms']
    assert verified == pytest.approx(told, rel=1e-6)
    words = ['--arm', f'{folder}/arm.yaml', '--correction', f'{folder}/correction.yaml']
    assert evaluate.main([new, *words]) == 0
    # targets and stations where they fit best
    assert 0.5 < json.loads(capsys.readouterr().out)['position']['rms'] / told <= 1


def test_evaluate_takes_points(bags, output: Path, capsys) -> None:
    assert evaluate.main([bags['test'], '--arm', str(output / 'arm.yaml')]) == 0
    record = json.loads(capsys.readouterr().out)
    result_schema.point_quality(record, oriented=True)
    assert record['position']['mean'] < 1.2e-4


def test_the_first_target_is_the_tool_of_compensate(output: Path, tmp_path: Path) -> None:
    table = tmp_path / 'targets.csv'
    table.write_text('x,y,z\n0.4,0.1,0.5\n')
    answer = tmp_path / 'joints.csv'
    assert compensate.main([str(output), str(table), str(answer), '--position-only']) == 0
    assert np.isfinite(np.loadtxt(answer, delimiter=',', skiprows=1, comments='#')).all()


@pytest.mark.parametrize(
    'given',
    [
        ['--objective', 'distance'],
        ['--probe', 'p.yaml'],
        ['--gauge', 'g.yaml'],
        ['--temperature', '22'],
    ],
)
def test_what_points_do_not_take_is_one_line(bags, capsys, given: list[str]) -> None:
    assert identify.main([bags['bag'], *given]) == 2
    line = capsys.readouterr().err
    assert line.count('\n') == 1
    assert given[0] in line


def test_points_and_probing_poses_are_no_one_measurement(
    bags, tmp_path: Path, capsys, passive_scene: Scene
) -> None:
    write_measurement(tmp_path / 'poses', passive_scene.measured)
    assert identify.main([bags['bag'], str(tmp_path / 'poses')]) == 2
    assert 'no one measurement' in capsys.readouterr().err
    assert identify.main([str(tmp_path / 'poses'), '--test', bags['bag']]) == 2
    assert 'holds measured points' in capsys.readouterr().err


def test_bags_with_the_probe_elsewhere_are_not_joined(
    tmp_path: Path, capsys, passive_scene: Scene
) -> None:
    measured = passive_scene.measured
    mount = measured.probe.flange_T_probe
    moved = replace(mount, translation=mount.translation + 0.02)
    other = replace(measured, probe=measured.probe.mounted(moved))
    write_measurement(tmp_path / 'one', measured)
    write_measurement(tmp_path / 'other', other)
    assert identify.main([str(tmp_path / 'one'), str(tmp_path / 'other'), '--quick']) == 2
    assert 'described in another way' in capsys.readouterr().err


def test_copies_count_once(bags, capsys) -> None:
    assert identify.main([bags['test'], bags['test'], '--quick']) == 0
    assert '40 points are copies of others' in capsys.readouterr().out


def test_a_message_read_quickly_is_what_the_type_system_reads() -> None:
    generator = np.random.default_rng(4)
    for name in ('1', 'nest', 'ä target', 'abcde'):
        for frame in ('', 'station_12', 'xyz'):
            joints, position = generator.normal(size=7), generator.normal(size=3)
            message = cdr.measured_point(
                123_456_789_012, frame, name, 9, joints, position, np.zeros(4), 1e-5
            )
            data = cdr.encode(message)
            assert _quickly(data) == _row_of(cdr.decode(MEASURED_POINT, data))
            assert _quickly(data[:-9]) is None
