# SPDX-License-Identifier: Apache-2.0
"""Tables of targets for `compensate`, and of the joint commands that it answers with."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import TableError
from calib_model.files import file_content
from calib_model.transforms import rotation_matrix

POSITION = ('x', 'y', 'z')
VECTOR = ('rx', 'ry', 'rz')
QUATERNION = ('qx', 'qy', 'qz', 'qw')
TIME = 'time'
#: by how much a quaternion's length may differ from 1: they are often written with few digits
LOOSE = 1e-2
#: m or rad: nothing that far is a target
FARTHEST = 1e4
LARGEST_TABLE = 32 * 1024 * 1024  # bytes
EXPECTED = 'expected x,y,z[,rx,ry,rz or qx,qy,qz,qw][,q1..qn], or q1..qn, and time where wanted'


@dataclass(frozen=True)
class TargetTable:
    """What a table asks for; what it has no columns for is None.

    `position` (N, 3), m, `rotation` (N, 3, 3) in the base frame; `joints` (N, n), rad: a joint
    trajectory or, beside positions, the postures to start from; `time` (N,), s, is handed on.
    `lines` (N,) are the rows' lines in `source`, if it is a file.
    """

    source: str
    lines: tuple[int, ...]
    position: Array | None
    rotation: Array | None
    joints: Array | None
    time: Array | None

    def place(self, row: int) -> str:
        """What an error calls a row."""
        return f'{self.source}, line {self.lines[row]}' if self.lines else f'row {row + 1}'


def read_targets(path: str | Path, n: int) -> TargetTable:
    """The targets in a CSV file with a header line, for an arm of n joints; SI units.

    Raises:
        TableError: names the line and the column that cannot be used.
    """
    source = str(path)
    try:
        text = file_content(path, LARGEST_TABLE).decode('utf-8-sig')
    except OSError as error:
        raise TableError(f'{source}: cannot be read: {error.strerror}') from error
    except UnicodeDecodeError as error:
        raise TableError(f'{source}: not UTF-8 text') from error
    header, rows, lines = _cells(text, source)
    _check_header(header, n, source)
    limits = [math.inf if name == TIME else FARTHEST for name in header]
    values = np.array(
        [
            [
                _number(cell, f'{source}, line {line}, column {name}', limit)
                for name, cell, limit in zip(header, row, limits, strict=True)
            ]
            for row, line in zip(rows, lines, strict=True)
        ]
    )
    columns = {name: values[:, i] for i, name in enumerate(header)}
    found = TargetTable(
        source,
        tuple(lines),
        _block(columns, POSITION),
        None,
        _block(columns, _joints(n)),
        columns.get(TIME),
    )
    rotation = _rotations(columns, found)
    return TargetTable(**{**vars(found), 'rotation': rotation})


def _cells(text: str, source: str) -> tuple[list[str], list[list[str]], list[int]]:
    reader = csv.reader(io.StringIO(text, newline=''), strict=True)
    rows, lines = [], []
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            if any(cells) and not cells[0].startswith('#'):
                rows.append(cells)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise TableError(f'{source}, line {reader.line_num}: not CSV: {error}') from error
    if len(rows) < 2:
        raise TableError(f'{source}: no rows below a header line: {EXPECTED}')
    header = [name.lower() for name in rows[0]]
    for row, line in zip(rows, lines, strict=True):
        if len(row) != len(header):
            problem = f'expected {len(header)} columns as in the header line, got {len(row)}'
            raise TableError(f'{source}, line {line}: {problem}')
    return header, rows[1:], lines[1:]


def _check_header(header: list[str], n: int, source: str) -> None:
    known = {*POSITION, *VECTOR, *QUATERNION, *_joints(n), TIME}
    for name in header:
        if name not in known or header.count(name) > 1:
            why = 'there twice' if name in known else f'unknown for an arm of {n} joints'
            raise TableError(f'{source}: column {name!r} is {why}: {EXPECTED}')
    for block in (POSITION, VECTOR, QUATERNION, _joints(n)):
        have = [name for name in block if name in header]
        if have and len(have) != len(block):
            missing = next(name for name in block if name not in header)
            raise TableError(f'{source}: no column {missing!r} beside {have[0]!r}: {EXPECTED}')
    if 'x' not in header and ('q1' not in header or 'rx' in header or 'qw' in header):
        raise TableError(f'{source}: no columns of positions or joints: {EXPECTED}')
    if 'rx' in header and 'qw' in header:
        raise TableError(f'{source}: a rotation vector and a quaternion: {EXPECTED}')


def _joints(n: int) -> tuple[str, ...]:
    return tuple(f'q{i}' for i in range(1, n + 1))


def _number(cell: str, place: str, farthest: float) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise TableError(f'{place}: expected a number, got {cell[:40]!r}')
    if abs(value) > farthest:
        raise TableError(f'{place}: expected {farthest:g} m or rad at most, got {value:g}')
    return value


def _block(columns: dict[str, Array], names: tuple[str, ...]) -> Array | None:
    if names[0] not in columns:
        return None
    return np.stack([columns[name] for name in names], axis=1)


def _rotations(columns: dict[str, Array], table: TargetTable) -> Array | None:
    vectors = _block(columns, VECTOR)
    quaternions = _block(columns, QUATERNION)
    if quaternions is not None:
        length = np.linalg.norm(quaternions, axis=1)
        for row in np.flatnonzero(np.abs(length - 1) > LOOSE):
            problem = f'expected a quaternion of length 1, got {length[row]:.3g}'
            raise TableError(f'{table.place(int(row))}: {problem}')
        part = quaternions[:, :3]
        sine = np.linalg.norm(part, axis=1)
        turn = 2 * np.arctan2(sine, quaternions[:, 3])
        vectors = part * (turn / np.where(sine > 0, sine, 1.0))[:, None]
    if vectors is None:
        return None
    return np.array([rotation_matrix(vector) for vector in vectors])


def joints_csv(joints: Array, time: Array | None = None, notes: Sequence[str] = ()) -> str:
    """Joint commands (N, n), rad, as CSV; every number comes back bit for bit. The notes are
    comments at its end."""
    header = list(_joints(joints.shape[1]))
    rows = joints.tolist()
    if time is not None:
        header.insert(0, TIME)
        rows = [[at, *row] for at, row in zip(time.tolist(), rows, strict=True)]
    lines = [','.join(header), *(','.join(map(repr, row)) for row in rows)]
    lines += [f'# {note}' for note in notes]
    return '\n'.join(lines) + '\n'
