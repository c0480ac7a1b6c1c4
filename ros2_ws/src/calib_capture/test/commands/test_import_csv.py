# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib_capture.commands import import_csv as command
from calib_model.bags import read_measurement
from calib_model.instruments import ActiveProbe, Gauge

HEADER = 'location,sphere,q1,q2,q3,q4,q5,q6,s1,s2,s3'
ROWS = (
    '1,1,0.1,0.2,0.3,0.4,0.5,0.6,0.001,0.0005,-0.0005',
    '2,14,-0.1,0.2,-0.3,0.4,-0.5,0.6,0.0011,0.0004,-0.0003',
)
TABLE = '\n'.join((HEADER, *ROWS)) + '\n'
Run = Callable[..., tuple[int, str]]


@pytest.fixture
def run(
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Run:
    """Import a table into tmp_path/bag: exit code and what was printed."""

    def imported(content: str | bytes, probe: str = 'active_trihedron') -> tuple[int, str]:
        table = tmp_path / 'table.csv'
        table.write_bytes(content if isinstance(content, bytes) else content.encode())
        monkeypatch.setattr(
            'sys.argv',
            [
                'import_csv',
                str(table),
                str(tmp_path / 'bag'),
                '--arm',
                str(config / 'arms' / 'kuka_kr5_sixx_r650.yaml'),
                '--probe',
                str(config / 'probes' / f'{probe}.yaml'),
                '--gauge',
                str(config / 'gauges' / 'ball_bar_kr5.yaml'),
            ],
        )
        code = command.main()
        printed = capsys.readouterr()
        return code, printed.err if code else printed.out

    return imported


def test_every_number_is_in_the_bag(run: Run, tmp_path: Path, gauge: Gauge) -> None:
    code, line = run(TABLE)
    assert code == 0
    assert line.count('\n') == 1
    assert '2 poses of kuka_kr5_sixx_r650 with active_trihedron, 2 spheres' in line
    measured = read_measurement(tmp_path / 'bag')
    expected = np.array([row.split(',') for row in ROWS], dtype=float)
    assert measured.poses.location.tolist() == [1, 2]
    assert measured.poses.sphere.tolist() == [1, 14]
    assert measured.poses.joints.tobytes() == expected[:, 2:8].tobytes()
    assert measured.poses.displacement.tobytes() == expected[:, 8:].tobytes()
    assert np.diff(measured.poses.stamp).min() > 0
    assert isinstance(measured.probe, ActiveProbe)
    assert measured.gauge == gauge


def test_a_passive_probe_needs_no_readings(run: Run, tmp_path: Path) -> None:
    table = '\n'.join(','.join(line.split(',')[:8]) for line in TABLE.splitlines())
    code, _ = run(table, 'seated_ball_iiwa14')
    assert code == 0
    assert not read_measurement(tmp_path / 'bag').poses.displacement.any()


@pytest.mark.parametrize(
    'content',
    [
        '\ufeff' + TABLE,
        TABLE.replace('\n', '\r\n'),
        TABLE.replace('\n', '\r'),
        TABLE.replace(',', ' ,  '),
        '\n\n' + TABLE.replace('\n', '\n\n,,\n'),
        TABLE.rstrip('\n'),
        TABLE.replace('location', ' Location').replace('q1', 'Q1'),
        '"' + TABLE.replace(',', '","').replace('\n', '"\n"').rstrip('"'),
        TABLE.replace('\n1,', '\n1.0,').replace('\n2,14', '\n2.0,1.4e1'),
        '\n'.join(','.join(reversed(line.split(','))) for line in TABLE.splitlines()),
    ],
)
def test_spreadsheets_habits_are_fine(run: Run, tmp_path: Path, content: str) -> None:
    assert run(content) == (0, run_line(tmp_path))
    poses = read_measurement(tmp_path / 'bag').poses
    assert poses.sphere.tolist() == [1, 14]
    assert poses.joints[1].tolist() == [-0.1, 0.2, -0.3, 0.4, -0.5, 0.6]


def run_line(tmp_path: Path) -> str:
    return (
        f'{tmp_path / "bag"}: 2 poses of kuka_kr5_sixx_r650 with active_trihedron, '
        '2 spheres of ball_bar_kr5 probed at 2 locations\n'
    )


@pytest.mark.parametrize(
    ('old', 'new', 'message'),
    [
        (',s1,s2,s3', '', 'line 1: no column s1 (expected location,sphere,q1'),
        (',q6', '', 'line 1: 5 joint columns, q1 to q5, but kuka_kr5_sixx_r650 has 6 joints'),
        ('s1,s2,s3', 's1,s2,s3,q7', 'line 1: 7 joint columns, q1 to q7, but'),
        ('q6', 'q5', 'line 1: no column q6'),
        ('q6', 'q6,q6', 'line 1: 7 joint columns'),
        ('s3', 's3,s3', "line 1: column 's3' is there twice"),
        ('s3', 's3,torque', "line 1: unknown column 'torque'"),
        ('location', 'place', 'line 1: no column location'),
        (HEADER + '\n', '', 'line 1: no column location'),
        (',0.5,', ',half,', "line 2, column q5: expected a number, got 'half'"),
        (',0.5,', ',,', "line 2, column q5: expected a number, got ''"),
        (',0.5,', ',nan,', 'line 2, column q5: expected a finite number, got nan'),
        (',0.5,', ',-inf,', 'line 2, column q5: expected a finite number, got -inf'),
        (',0.5,', ',1e999,', 'line 2, column q5: expected a finite number'),
        (',0.5,', ',0_5,', "line 2, column q5: expected a number, got '0_5'"),
        ('-0.3,', '-30,', 'line 3, column q3: expected rad within [-3.648, 1.309]'),
        ('-0.3,', '2.5,', 'line 3, column q3: expected rad within [-3.648, 1.309] for joint_a3'),
        ('0.0011', '1.1', 'line 3, column s1: expected m within the stroke [-0.003, 0.003]'),
        ('\n2,14', '\n2,16', 'line 3, column sphere: ball_bar_kr5 has no sphere 16'),
        ('\n2,14', '\n2,1.5', 'line 3, column sphere: expected a whole number'),
        ('\n2,14', '\n0,14', 'line 3, column location: expected a whole number from 1'),
        ('\n2,14', '\n70000,14', 'line 3, column location: expected a whole number from 1'),
        ('-0.0005\n', '-0.0005,9\n', 'line 2: expected 11 columns as in the header line, got 12'),
        ('-0.0005\n', '\n', 'line 2, column s3: expected a number'),
        (',-0.0005\n', '\n', 'line 2: expected 11 columns as in the header line, got 10'),
        (TABLE, '', 'empty, expected the header line location,sphere,q1'),
        (TABLE, HEADER, 'no rows below the header line'),
        (TABLE, TABLE.replace(',', ';'), 'line 1: no column location'),
        ('1,1,0.1', '1,1,"0.1', 'not CSV'),
        ('1,1,0.1', '1,1,\x000.1', 'line 2'),
    ],
)
def test_errors_name_line_and_column_and_leave_nothing_behind(
    run: Run, tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in TABLE
    code, line = run(TABLE.replace(old, new, 1))
    assert code == 2
    assert line.count('\n') == 1
    assert line.startswith(str(tmp_path / 'table.csv'))
    assert message in line
    assert [path.name for path in tmp_path.iterdir()] == ['table.csv']


def test_degrees_and_millimetres_are_asked_about(run: Run) -> None:
    assert 'is it in degrees?' in run(TABLE.replace('-0.3,', '-30,'))[1]
    assert 'is it in mm?' in run(TABLE.replace('0.0011', '1.1'))[1]


def test_the_controllers_own_count_is_offered_where_it_would_fit(run: Run) -> None:
    """Of the KR 5, q3 = A3 - 90 deg: 2.6 rad is no joint position, but A3 may well be there."""
    third = TABLE.splitlines()[1].split(',')
    for value, said in (
        ('2.6', ': is it A3 as the controller shows it? (q = A3 -1.5708 rad)'),
        ('150', ': is it A3 in degrees as the controller shows it?'),
        ('-150', ': is it in degrees?'),
        ('500', ': is it in degrees, or counted from another zero?'),
    ):
        line = run(TABLE.replace(','.join(third), ','.join([*third[:4], value, *third[5:]]), 1))[1]
        assert 'column q3' in line and said in line


def test_readings_of_a_passive_probe_are_refused(run: Run) -> None:
    code, line = run(TABLE, 'seated_ball_iiwa14')
    assert code == 2
    assert "unknown column 's1'" in line
    assert 'seated_ball_iiwa14' in line


def test_text_in_another_encoding_is_refused(run: Run) -> None:
    assert 'not UTF-8 text' in run(TABLE.encode('utf-16'))[1]


def test_a_bag_is_never_overwritten(run: Run, tmp_path: Path) -> None:
    run(TABLE)
    before = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    code, line = run(TABLE.replace('0.1', '0.2'))
    assert code == 2
    assert 'exists already' in line
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_bytes() == before


def test_a_failing_disk_leaves_nothing_behind(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, measured: object, progress: object = None) -> None:
        path.mkdir()
        (path / 'bag_0.mcap').write_bytes(b'half')
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(command.bags, 'write_measurement', full)
    code, line = run(TABLE)
    assert code == 2
    assert line == f'{tmp_path / "bag"}: cannot be written: No space left on device\n'
    assert [path.name for path in tmp_path.iterdir()] == ['table.csv']


def test_files_that_are_not_there_are_named(
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    arguments = ['import_csv', str(tmp_path / 'no.csv'), str(tmp_path / 'bag')]
    for name in ('arms/kuka_kr5_sixx_r650', 'probes/active_trihedron', 'gauges/ball_bar_kr5'):
        arguments += [f'--{name.split("/")[0][:-1]}', str(config / f'{name}.yaml')]
    monkeypatch.setattr('sys.argv', arguments)
    assert command.main() == 2
    assert 'no.csv: cannot be read: No such file or directory' in capsys.readouterr().err
    arguments[4] = str(tmp_path / 'no.yaml')
    assert command.main() == 2
    assert 'no.yaml: cannot be read: No such file or directory' in capsys.readouterr().err
