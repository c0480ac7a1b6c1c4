# SPDX-License-Identifier: Apache-2.0
"""Tables of targets or joints turned into joint commands by a finished calibration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib_model.arrays import Array
from calib_model.command_line import UsageError
from calib_model.errors import CalibrationError, DataError
from calib_model.files import write_whole
from calib_model.transforms import RigidTransform, rotation_matrix
from calib_solver.compensation.calibrated_arm import Calibrated, read_calibrated
from calib_solver.compensation.inverse_kinematics import Targets
from calib_solver.compensation.joint_commands import (
    Compensated,
    compensate_joints,
    compensate_targets,
)
from calib_solver.compensation.path import path_notes
from calib_solver.compensation.target_table import FARTHEST, TargetTable, joints_csv, read_targets

TOOL = "expected 'probe', 'flange' or x,y,z[,rx,ry,rz] in m and rad"


@dataclass(frozen=True)
class Finished:
    """The answer, what is to be said of its rows, and the files written."""

    done: Compensated
    notes: tuple[str, ...]
    written: tuple[Path, ...]

    @property
    def change(self) -> float:
        """The largest change of a joint command, rad."""
        return float(np.nanmax(np.abs(self.done.joints - self.done.nominal)))

    @property
    def miss(self) -> Array:
        """What the nominal commands of the rows that are reached would miss by, m."""
        return np.delete(self.done.miss, list(self.done.unreached))

    @property
    def verdict(self) -> str:
        """How much was made good, in one line."""
        miss = 1e3 * self.miss
        largest = np.degrees(self.change)
        out = len(self.done.unreached)
        return (
            f'{len(miss)} targets: the nominal commands would miss by {miss.mean():.4f} mm '
            f'on average, {miss.max():.4f} mm at most; joints changed by up to {largest:.4f} deg'
            + (f'; {out} more not reached' if out else '')
        )


def with_tool(calibrated: Calibrated, tool: str) -> Calibrated:
    """The calibration with the tool that a command line or a request names.

    Raises:
        UsageError: it is not one.
    """
    if tool in ('', 'probe'):
        return calibrated
    if tool == 'flange':
        return calibrated.with_tool(RigidTransform())
    try:
        numbers = np.array([float(part) for part in tool.split(',')])
    except ValueError:
        numbers = np.array([])
    if len(numbers) not in (3, 6) or not np.isfinite(numbers).all():
        raise UsageError(f'no tool {tool!r}: {TOOL}')
    turn = numbers[3:] if len(numbers) == 6 else np.zeros(3)
    return calibrated.with_tool(RigidTransform(numbers[:3], turn))


def compensate_table(
    calibrated: Calibrated, table: TargetTable, position_only: bool = False
) -> Compensated:
    """The answer to a table's rows.

    Raises:
        CompensationError: names the line that the arm does not reach.
    """
    if table.position is None:
        assert table.joints is not None
        return compensate_joints(calibrated, table.joints, position_only, table.place)
    rotation = None if position_only else table.rotation
    return compensate_targets(
        calibrated, Targets(table.position, rotation), table.joints, table.place
    )


def compensate_file(
    result: str,
    table: str | Callable[[int], TargetTable],
    output: str = '',
    tool: str = '',
    position_only: bool = False,
) -> Finished:
    """From the folder of a result and targets to a table of joint commands: the command's work.

    `table` is the path of a table, or makes one for an arm of n joints.

    Raises:
        CalibrationError: anything that keeps it from being done; nothing is written then.
    """
    calibrated = with_tool(read_calibrated(result), tool)
    n = calibrated.identified.n
    rows = read_targets(table, n) if isinstance(table, str) else table(n)
    done = compensate_table(calibrated, rows, position_only)
    notes = path_notes(calibrated.identified, done, rows)
    return Finished(done, notes, write_joints(output, done, rows.time, notes))


def rows_of(n: int, position: Array, rotation_vector: Array, joint_position: Array) -> TargetTable:
    """Targets given row after row, for an arm of n joints; what is empty is not given.

    Raises:
        DataError: they are no whole rows, or not as many.
    """
    blocks: list[Array | None] = []
    count = 0
    for name, values, width in (
        ('position', position, 3),
        ('rotation_vector', rotation_vector, 3),
        ('joint_position', joint_position, n),
    ):
        if len(values) % width or (count and len(values) not in (0, count * width)):
            expected = f'{count} rows of {width}' if count else f'rows of {width}'
            raise DataError(f'{name}: expected {expected} numbers, got {len(values)} in all')
        if not (np.abs(values) <= FARTHEST).all():
            raise DataError(f'{name}: expected numbers up to {FARTHEST:g} (m or rad)')
        count = count or len(values) // width
        blocks.append(np.reshape(values, (-1, width)) if len(values) else None)
    if blocks[0] is None and (blocks[1] is not None or blocks[2] is None):
        raise DataError('no table, no position and no joint_position given')
    turns = blocks[1]
    rotation = None if turns is None else np.array([rotation_matrix(row) for row in turns])
    return TargetTable('', (), blocks[0], rotation, blocks[2], None)


def write_joints(
    output: str, done: Compensated, time: Array | None = None, notes: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Write the joint commands, whole or not at all, the notes as comments behind them; '' is
    nowhere.

    Raises:
        CalibrationError: it cannot be written.
    """
    if not output:
        return ()
    try:
        write_whole(output, joints_csv(done.joints, time, notes))
    except OSError as error:
        raise CalibrationError(f'{output}: cannot be written: {error.strerror}') from error
    return (Path(output),)
