# SPDX-License-Identifier: Apache-2.0
"""A table of probing poses as CSV text: `location,sphere,q1..qn[,s1,s2,s3]`, SI units."""

from __future__ import annotations

import csv
import io
import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.errors import TableError
from calib_model.files import file_content
from calib_model.instruments import STYLI, ActiveProbe, Arm, Gauge, Joint, Probe
from calib_model.measurement import ProbingSet

LARGEST_NUMBER = 65535  # of locations and spheres: ProbingPose holds them in 16 bits
TURNS = 4 * math.pi  # no revolute joint goes further, so what does was not written in rad
BEYOND = 1.0  # rad past a limit that cannot be a matter of a slightly different arm
PERIOD = 100_000_000  # ns from row to row: a table has no times, a bag wants some


@dataclass(frozen=True)
class Row:
    """One line of the table; errors name it."""

    file: Path
    line: int
    cells: dict[str, str]

    def refuse(self, column: str, problem: str) -> TableError:
        """The error that names the row, the column and the problem."""
        return TableError(f'{self.file}, line {self.line}, column {column}: {problem}')

    def number(self, column: str) -> float:
        """A finite number."""
        text = self.cells[column]
        try:
            value = float(text.replace('_', '?'))  # Python's 1_000 is no number in a table
        except ValueError:
            raise self.refuse(column, f'expected a number, got {text[:40]!r}') from None
        if not math.isfinite(value):
            raise self.refuse(column, f'expected a finite number, got {text}')
        return value

    def count(self, column: str) -> int:
        """A whole number from 1 on."""
        value = self.number(column)
        if value != int(value) or not 1 <= value <= LARGEST_NUMBER:
            expected = f'expected a whole number from 1 to {LARGEST_NUMBER}'
            raise self.refuse(column, f'{expected}, got {self.cells[column]}')
        return int(value)


@dataclass(frozen=True)
class _Header:
    """The columns that a table needs, and the instruments that ask for them."""

    columns: list[str]
    arm: Arm
    probe: Probe

    def check(self, place: str, header: list[str]) -> None:
        """Refuse a header line that lacks, repeats or has too many columns."""
        expected = f'{",".join(self.columns)} for {self.arm.name} with {self.probe.name}'
        joints = [name for name in header if name[:1] == 'q' and name[1:].isdecimal()]
        if joints and len(joints) != self.arm.n:
            found = f'{len(joints)} joint columns, {joints[0]} to {joints[-1]}'
            raise TableError(f'{place}: {found}, but {self.arm.name} has {self.arm.n} joints')
        for name in self.columns:
            if name not in header:
                raise TableError(f'{place}: no column {name} (expected {expected})')
        for name in header:
            if header.count(name) > 1:
                raise TableError(f'{place}: column {name!r} is there twice')
            if name not in self.columns:
                raise TableError(f'{place}: unknown column {name!r} (expected {expected})')


def read_table(file: Path, arm: Arm, probe: Probe, gauge: Gauge) -> ProbingSet:
    """The probing poses of a table taken with these instruments.

    A byte-order mark, blank lines, spaces around cells, any line ends and any order of the columns
    are fine. Stamps are made up: a tenth of a second from row to row.

    Raises:
        TableError: names the file, the line and the column, and what was expected there.
    """
    joints = [f'q{i}' for i in range(1, arm.n + 1)]
    strokes = probe.stroke.tolist() if isinstance(probe, ActiveProbe) else []
    styli = [f's{i}' for i in range(1, len(strokes) + 1)]
    location, sphere = array('l'), array('l')
    q, s = array('d'), array('d')  # lists of floats would take five times the room
    header = _Header(['location', 'sphere', *joints, *styli], arm, probe)
    for row in _rows(file, header):
        location.append(row.count('location'))
        sphere.append(row.count('sphere'))
        if sphere[-1] not in gauge.numbers:
            known = ', '.join(map(str, gauge.numbers))
            problem = f'{gauge.name} has no sphere {sphere[-1]} (it has {known})'
            raise row.refuse('sphere', problem)
        q.extend(joint_position(row, column, arm, i) for i, column in enumerate(joints))
        read = [_reading(row, *stylus) for stylus in zip(styli, strokes, strict=True)]
        s.extend(read or [0.0] * STYLI)
    if not location:
        raise TableError(f'{file}: no rows below the header line')
    count = len(location)
    stamps = np.arange(1, count + 1, dtype=np.int64) * PERIOD
    return ProbingSet(
        np.array(location),
        np.array(sphere),
        np.reshape(q, (count, -1)),
        np.reshape(s, (count, -1)),
        stamps,
        np.ones(count, dtype=np.int64),
    )


def joint_position(row: Row, column: str, arm: Arm, i: int, unit: float = 1.0) -> float:
    """A joint's cell times `unit`, as far as the arm's joint `i` may be there."""
    value, joint = row.number(column) * unit, arm.joints[i]
    lower, upper = joint.limits
    if not _fits(value, joint):
        expected = f'expected rad within [{lower:.3f}, {upper:.3f}] for {joint.name}'
        raise row.refuse(column, f'{expected}, got {value:g}{_guess(value, joint)}')
    return value


def _fits(value: float, joint: Joint) -> bool:
    lower, upper = joint.limits
    return abs(value) <= TURNS and lower - BEYOND <= value <= upper + BEYOND


def _guess(value: float, joint: Joint) -> str:
    """What a joint position may be that is beyond its limits in rad."""
    axis = joint.controller
    for unit, angle in (('', value), (' in degrees', math.radians(value))):
        if unit and _fits(angle, joint):
            return ': is it in degrees?'
        if axis is None or (axis.zero == 0 and axis.direction == 1):
            continue
        if _fits(axis.zero + axis.direction * angle, joint):
            turn = '-' if axis.direction < 0 else ''
            return (
                f': is it {axis.name}{unit} as the controller shows it? '
                f'(q = {turn}{axis.name} {axis.zero:+.4f} rad)'
            )
    return ': is it in degrees, or counted from another zero?'


def _reading(row: Row, column: str, stroke: tuple[float, float]) -> float:
    value = row.number(column)
    lower, upper = stroke
    travel = upper - lower
    if not lower - travel <= value <= upper + travel:
        expected = f'expected m within the stroke [{lower:g}, {upper:g}]'
        raise row.refuse(column, f'{expected}, got {value:g}: is it in mm?')
    return value


def _rows(file: Path, expected: _Header) -> Iterator[Row]:
    """The rows below the header line, blank ones left out."""
    header: list[str] = []
    for line, cells in csv_lines(file):
        cells = [cell.strip() for cell in cells]
        if not any(cells):
            continue
        if not header:
            header = [cell.lower() for cell in cells]
            expected.check(f'{file}, line {line}', header)
        elif len(cells) != len(header):
            problem = f'expected {len(header)} columns as in the header line, got {len(cells)}'
            raise TableError(f'{file}, line {line}: {problem}')
        else:
            yield Row(file, line, dict(zip(header, cells, strict=True)))
    if not header:
        raise TableError(f'{file}: empty, expected the header line {",".join(expected.columns)}')


def csv_lines(file: Path) -> Iterator[tuple[int, list[str]]]:
    """The lines of a CSV file with their numbers.

    Raises:
        TableError: it cannot be read, or is no such file.
    """
    try:
        content = io.BytesIO(file_content(file))
    except OSError as error:
        raise TableError(f'{file}: cannot be read: {error.strerror}') from error
    # decoded as it is read: text takes four times the room
    text = io.TextIOWrapper(content, encoding='utf-8-sig', newline='')
    reader = csv.reader(text, strict=True)
    try:
        for cells in reader:
            yield reader.line_num, cells
    except UnicodeDecodeError as error:
        raise TableError(f'{file}: not UTF-8 text') from error
    except csv.Error as error:
        raise TableError(f'{file}, line {reader.line_num}: not CSV: {error}') from error
