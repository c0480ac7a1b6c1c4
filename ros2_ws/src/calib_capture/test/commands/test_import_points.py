# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands import import_points as command
from calib_model.bags import read_points
from calib_model.transforms import quaternion_rotations, rotation_matrix

JOINTS = '5,-20,30,10,-40,12'
Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Run:
    """Import a table into tmp_path/bag: exit code and what was printed."""

    def imported(content: str, *more: str) -> tuple[int, str]:
        table = tmp_path / 'table.csv'
        table.write_text(content)
        arm = config / 'arms' / 'kuka_kr5_sixx_r650.yaml'
        given = ['import_points', str(table), str(tmp_path / 'bag'), '--arm', str(arm), *more]
        monkeypatch.setattr('sys.argv', given)
        code = command.main()
        printed = capsys.readouterr()
        return code, printed.err if code else printed.out

    return imported


def test_every_column_is_in_the_bag_in_si_units(run: Run, tmp_path: Path) -> None:
    head = 'target,station,q1,q2,q3,q4,q5,q6,x,y,z,rx,ry,rz,sigma'
    rows = f'left,2,{JOINTS},1500,-20.5,3,30,-60,90,0.05\n2.0,1,{JOINTS},1,2,3,,,,0.1'
    code, line = run(f'{head}\n{rows}\n', '--length', 'mm', '--angle', 'deg')
    assert code == 0
    assert '2 points' in line
    assert '2 targets seen from 2 stations, 1 with orientation' in line
    points = read_points(tmp_path / 'bag').points
    assert points.target.tolist() == ['left', '2']
    assert points.station.tolist() == [2, 1]
    np.testing.assert_allclose(points.joints[0], np.radians(np.array(JOINTS.split(','), float)))
    np.testing.assert_allclose(points.position, [[1.5, -0.0205, 3e-3], [1e-3, 2e-3, 3e-3]])
    np.testing.assert_allclose(points.sigma, [5e-5, 1e-4])
    np.testing.assert_allclose(
        quaternion_rotations(points.orientation[:1])[0],
        rotation_matrix(np.radians([30.0, -60.0, 90.0])),
        atol=1e-14,
    )
    assert points.oriented.tolist() == [True, False]


def test_joints_may_have_the_names_of_the_arm(run: Run, tmp_path: Path, kr5) -> None:
    head = ','.join([*reversed(kr5.joint_names), 'x', 'y', 'z'])
    assert run(f'{head}\n0.1,0.2,0.3,-0.4,0.5,0.6,1,2,3\n')[0] == 0
    assert read_points(tmp_path / 'bag').points.joints[0].tolist() == [
        0.6,
        0.5,
        -0.4,
        0.3,
        0.2,
        0.1,
    ]


@pytest.mark.parametrize(
    ('head', 'row', 'words'),
    [
        ('x,y', '1,2', 'line 1: no column z'),
        ('x,y,z,w', '1,2,3,4', "unknown column 'w'"),
        ('x,y,z', '1,?,3', 'line 2, column y: expected a number'),
        ('x,y,z', '1500,2,3', 'is it in mm?'),
        ('x,y,z,station', '1,2,3,0', 'column station: expected a whole number'),
        ('x,y,z,sigma', '1,2,3,0', 'column sigma: expected more than 0'),
        ('x,y,z,target', '1,2,3,', 'column target: expected a name'),
        ('x,y,z,qx,qy,qz,qw', '1,2,3,1,1,0,0', 'expected a unit quaternion'),
        ('x,y,z,rx,ry', '1,2,3,0,0', 'no column rz'),
        ('x,y,z,rx,qx', '1,2,3,0,0', 'expected one of them'),
    ],
)
def test_what_cannot_be_used_is_named(
    run: Run, tmp_path: Path, head: str, row: str, words: str
) -> None:
    table = f'q1,q2,q3,q4,q5,q6,{head}\n0.1,0.2,0.3,0.4,0.5,0.6,{row}\n'
    code, line = run(table)
    assert code == 2
    assert words in line
    assert 'table.csv' in line
    assert line.count('\n') == 1
    assert not (tmp_path / 'bag').exists()


def test_degrees_for_radians_are_named(run: Run) -> None:
    code, line = run(f'q1,q2,q3,q4,q5,q6,x,y,z\n{JOINTS},1,2,3\n')
    assert code == 2
    assert 'line 2, column q2' in line or 'line 2, column q1' in line
