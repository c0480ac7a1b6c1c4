# SPDX-License-Identifier: Apache-2.0
"""Whether joint commands can be run one after the other, and what is to be said of their rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calib_model.instruments import Arm
from calib_solver.compensation.inverse_kinematics import Rows
from calib_solver.compensation.joint_commands import Compensated
from calib_solver.compensation.singularity import jumps
from calib_solver.compensation.target_table import TargetTable

MOST = 20  # lines of one kind


def path_notes(arm: Arm, done: Compensated, table: TargetTable) -> tuple[str, ...]:
    """A line for each row that is not reached, each stretch that is held back near a singularity,
    each jump, and each step that the joints' speeds do not allow, where the table has times."""
    kinds = (
        list(done.unreached.values()),
        list(_held(done, table)),
        list(_jumps(arm, done, table)),
        list(_too_fast(arm, done, table)),
    )
    return tuple(line for lines in kinds for line in _some(lines))


def _some(lines: list[str]) -> list[str]:
    more = len(lines) - MOST
    return lines if more <= 0 else [*lines[:MOST], f'and {more} more such lines']


def _held(done: Compensated, table: TargetTable) -> Iterator[str]:
    for first, last in _stretches(done.held):
        left = 1e3 * done.left[first : last + 1].max()
        turn = np.degrees(done.left_turn[first : last + 1].max())
        yield (
            f'{_rows(table, first, last)}: near a singularity the joints keep to the program, '
            f'the tool stays up to {left:.4f} mm and {turn:.4f} deg off'
        )


def _jumps(arm: Arm, done: Compensated, table: TargetTable) -> Iterator[str]:
    for row in map(int, np.flatnonzero(jumps(done.nominal, done.joints))):
        step = done.joints[row + 1] - done.joints[row]
        joint = int(np.abs(step).argmax())
        jump = (
            f'{1e3 * step[joint]:+.2f} mm'
            if arm.prismatic[joint]
            else f'{np.degrees(step[joint]):+.2f} deg'
        )
        yield f'{_rows(table, row, row + 1)}: {arm.joint_names[joint]} jumps by {jump}'


def _too_fast(arm: Arm, done: Compensated, table: TargetTable) -> Iterator[str]:
    if table.time is None or len(table.time) < 2:
        return
    seconds = np.diff(table.time)
    step = np.diff(done.joints, axis=0)
    for row in map(int, np.flatnonzero(~(seconds > 0))):
        yield f'{_rows(table, row, row + 1)}: time does not go on'
    speed = np.abs(step) / np.where(seconds > 0, seconds, np.inf)[:, None]
    for row in map(int, np.flatnonzero((speed > arm.velocity).any(axis=1))):
        joint = int((speed[row] / arm.velocity).argmax())
        moved = arm.joints[joint]
        yield (
            f'{_rows(table, row, row + 1)}: {moved.name} would have to '
            f'{"slide" if moved.prismatic else "turn"} at {speed[row, joint]:.4g} {moved.unit}/s, '
            f'it can {moved.velocity:.4g}'
        )


def _stretches(rows: Rows) -> Iterator[tuple[int, int]]:
    """First and last of each run of successive rows."""
    if len(rows):
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            yield int(run[0]), int(run[-1])


def _rows(table: TargetTable, first: int, last: int) -> str:
    if first == last:
        return table.place(first)
    if table.lines:
        return f'{table.source}, lines {table.lines[first]} to {table.lines[last]}'
    return f'rows {first + 1} to {last + 1}'
