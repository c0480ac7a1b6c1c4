# SPDX-License-Identifier: Apache-2.0
"""A table of measured points as CSV text: joints, `x,y,z` of a target in a tracker's frame, and
what is known besides."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_capture.commands.pose_table import PERIOD, Row, csv_lines, joint_position
from calib_model.errors import TableError
from calib_model.instruments import Arm
from calib_model.measured_points import FARTHEST, UNIT, PointSet
from calib_model.transforms import rotation_vector_quaternion

POSITION = ('x', 'y', 'z')
QUATERNION = ('qx', 'qy', 'qz', 'qw')
ROTATION_VECTOR = ('rx', 'ry', 'rz')
OPTIONAL = ('target', 'station', 'sigma')
LONGEST_NAME = 100  # characters of a target's name
LENGTHS = {'m': 1.0, 'mm': 1e-3}
ANGLES = {'rad': 1.0, 'deg': math.pi / 180}


@dataclass(frozen=True)
class Units:
    """What the table's lengths and angles are multiplied by to be m and rad."""

    length: float = 1.0
    angle: float = 1.0


@dataclass(frozen=True)
class _Columns:
    """Which columns of a header line are what."""

    joints: tuple[str, ...]
    orientation: tuple[str, ...]
    optional: tuple[str, ...]


def read_point_table(file: Path, arm: Arm, units: Units) -> PointSet:
    """The points of a table; joints are `q1..qn` or have the arm's own names.

    A byte-order mark, blank lines, spaces around cells, any line ends and any order of the columns
    are fine. Stamps are made up: a tenth of a second from row to row.

    Raises:
        TableError: names the file, the line and the column, and what was expected there.
    """
    target: list[str] = []
    station = array('l')
    joints, position, orientation, sigma = (array('d') for _ in range(4))
    for columns, row in _rows(file, arm):
        joints.extend(
            joint_position(row, column, arm, i, _joint_unit(arm, i, units))
            for i, column in enumerate(columns.joints)
        )
        position.extend(_length(row, column, units) for column in POSITION)
        orientation.extend(_orientation(row, columns.orientation, units))
        target.append(_target(row) if 'target' in columns.optional else '1')
        station.append(row.count('station') if 'station' in columns.optional else 1)
        sigma.append(_sigma(row, units) if 'sigma' in columns.optional else 0.0)
    if not target:
        raise TableError(f'{file}: no rows below the header line')
    count = len(target)
    return PointSet(
        np.array(target),
        np.array(station),
        np.reshape(joints, (count, -1)),
        np.reshape(position, (count, 3)),
        np.reshape(orientation, (count, 4)),
        np.array(sigma),
        np.arange(1, count + 1, dtype=np.int64) * PERIOD,
    )


def _joint_unit(arm: Arm, i: int, units: Units) -> float:
    """A joint that slides is in the unit of length."""
    slides = getattr(arm.joints[i], 'type', 'revolute') == 'prismatic'
    return units.length if slides else units.angle


def _length(row: Row, column: str, units: Units) -> float:
    value = row.number(column) * units.length
    if abs(value) > FARTHEST:
        raise row.refuse(column, f'expected {FARTHEST:g} m at most, got {value:g} m: is it in mm?')
    return value


def _sigma(row: Row, units: Units) -> float:
    value = row.number('sigma') * units.length
    if not 0 < value <= 1:
        raise row.refuse('sigma', f'expected more than 0 and 1 m at most, got {value:g} m')
    return value


def _target(row: Row) -> str:
    name = row.cells['target']
    if not name or len(name) > LONGEST_NAME or not name.isprintable():
        raise row.refuse('target', f'expected a name or a number, got {name[:40]!r}')
    # 2 and 2.0, as spreadsheets write it, are one target
    whole = name.removesuffix('.0')
    return whole if whole.isdecimal() else name


def _orientation(row: Row, columns: tuple[str, ...], units: Units) -> list[float]:
    """A unit quaternion x y z w; zeros where the table has none, or this row leaves it empty."""
    if not columns or not any(row.cells[column] for column in columns):
        return [0.0] * 4
    values = np.array([row.number(column) for column in columns])
    if columns == ROTATION_VECTOR:
        return list(rotation_vector_quaternion(values * units.angle))
    length = float(np.linalg.norm(values))
    if abs(length - 1) > UNIT:
        raise row.refuse('qx', f'expected a unit quaternion, got one of length {length:g}')
    return list(values / length)


def _rows(file: Path, arm: Arm) -> Iterator[tuple[_Columns, Row]]:
    """The rows below the header line with what their columns are, blank ones left out."""
    header: list[str] = []
    columns: _Columns | None = None
    for line, cells in csv_lines(file):
        cells = [cell.strip() for cell in cells]
        if not any(cells):
            continue
        if columns is None:
            names = {name.lower(): name for name in arm.joint_names}
            header = [names.get(cell.lower(), cell.lower()) for cell in cells]
            columns = _columns(f'{file}, line {line}', header, arm)
        elif len(cells) != len(header):
            problem = f'expected {len(header)} columns as in the header line, got {len(cells)}'
            raise TableError(f'{file}, line {line}: {problem}')
        else:
            yield columns, Row(file, line, dict(zip(header, cells, strict=True)))
    if columns is None:
        raise TableError(f'{file}: empty, expected a header line: q1..q{arm.n},x,y,z')


def _columns(place: str, header: list[str], arm: Arm) -> _Columns:
    numbered = tuple(f'q{i}' for i in range(1, arm.n + 1))
    own = set(arm.joint_names) <= set(header) and not set(numbered) <= set(header)
    joints = arm.joint_names if own else numbered
    expected = f'{",".join(joints)},x,y,z for {arm.name}'
    if not own:
        counted = [name for name in header if name[:1] == 'q' and name[1:].isdecimal()]
        if counted and len(counted) != arm.n:
            found = f'{len(counted)} joint columns, {counted[0]} to {counted[-1]}'
            raise TableError(f'{place}: {found}, but {arm.name} has {arm.n} joints')
    orientations = [each for each in (QUATERNION, ROTATION_VECTOR) if set(each) & set(header)]
    if len(orientations) > 1:
        raise TableError(f'{place}: both qx,qy,qz,qw and rx,ry,rz: expected one of them')
    orientation = orientations[0] if orientations else ()
    for name in (*joints, *POSITION, *orientation):
        if name not in header:
            raise TableError(f'{place}: no column {name} (expected {expected})')
    known = {*joints, *POSITION, *orientation, *OPTIONAL}
    for name in header:
        if header.count(name) > 1:
            raise TableError(f'{place}: column {name!r} is there twice')
        if name not in known:
            more = ', '.join(('qx,qy,qz,qw or rx,ry,rz', *OPTIONAL))
            raise TableError(f'{place}: unknown column {name!r} (expected {expected}; also {more})')
    return _Columns(joints, orientation, tuple(name for name in OPTIONAL if name in header))
