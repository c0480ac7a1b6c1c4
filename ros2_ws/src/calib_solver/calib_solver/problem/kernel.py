# SPDX-License-Identifier: Apache-2.0
"""The compiled passes over poses and points, on all cores; numpy does the same, slower."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from threading import Thread

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import ParameterError
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import ParameterTable
from calib_model.transforms import left_jacobian, rotation_matrix
from calib_solver.problem.problem import IntArray, Problem, Turned

try:
    from calib_solver.problem import _kernel
except ImportError:  # not compiled here
    _kernel = None  # type: ignore[assignment, unused-ignore]

MOST_JOINTS = 16
MOST_TERMS = 9  # of joint errors
TILE = 4
#: below this many poses a second thread costs more than it saves
POSES_PER_THREAD = 2000
#: columns of a target's place and a station's, behind the parameters'
PLACES = 12


@dataclass(frozen=True)
class RawSums:
    """What the pass adds up, before means are taken off: `weight` (S,), a point near each sphere
    `reference` (S, 3), `moment` and `spread` (S, 3) of the deviations from it, `jacobian`
    (S, 3, F), and `normal` (S, P, P), whose column F belongs to the deviations."""

    weight: Array
    reference: Array
    moment: Array
    spread: Array
    jacobian: Array
    normal: Array


@dataclass(frozen=True)
class Points:
    """N measured points, the S groups of one target and one station in rows `start[s]` to
    `start[s + 1]`: postures `turned` and `joints` (N, n), `centers` (N, 3) of the targets on the
    flange, and what is predicted less what was measured, `position` (N, 3) and `turn` (N, 3), with
    weights `weight` and `turn_weight` (N,); None where there are no rotations."""

    turned: Turned
    joints: Array
    start: IntArray
    centers: Array
    weight: Array
    position: Array
    turn_weight: Array | None
    turn: Array | None


def available(n: int, table: ParameterTable) -> bool:
    """Whether the compiled passes are there and take an arm of n joints."""
    terms = 0 if table.joint_terms is None else table.joint_terms.count
    return _kernel is not None and n <= MOST_JOINTS and terms <= MOST_TERMS


@cache
def threads() -> int:
    """Cores this process may use; `CALIB_THREADS` sets another number.

    Raises:
        ParameterError: it is none.
    """
    given = os.environ.get('CALIB_THREADS', '') or '0'
    if not given.isdecimal() or len(given) > 4:
        raise ParameterError(f'CALIB_THREADS: expected a number of threads, got {given!r}')
    return int(given) or len(os.sched_getaffinity(0))


def raw_sums(problem: Problem, table: ParameterTable, full: Array) -> RawSums:
    """The sums at the parameters `full`, sphere by sphere: independent of the number of threads."""
    spheres, free = len(problem.keys), len(table.free_columns)
    padded = _padded(free + 1)
    raw = RawSums(
        np.zeros(spheres),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3, free)),
        np.zeros((spheres, padded, padded)),
    )
    outputs = tuple(vars(raw).values())
    measured = problem.measured
    inputs = (
        problem.cosine,
        problem.sine,
        problem.slide,
        problem.centers,
        problem.weight,
        problem.start,
        *_model(measured.arm, table, full),
        *_joint_terms(measured.arm, measured.probe, table, full, problem.joints),
    )
    _spread(problem.start, lambda first, last: _kernel.accumulate(inputs, outputs, first, last))
    return raw


def raw_point_sums(
    points: Points, arm: Arm, flange: Probe, table: ParameterTable, full: Array
) -> tuple[Array, Array | None]:
    """J'J (S, D + 1, D + 1) of positions and, where there are any, of rotations, for each group of
    points, by D = F + 12 columns: those of the parameters, then of the target's translation and
    rotation in the flange and the base's in itself; the residuals are the last column.

    `flange` is a probe at the flange itself, whose place is no part of `full`.
    """
    columns = len(table.free_columns) + PLACES + 1
    padded, groups = _padded(columns), len(points.start) - 1
    turns = points.turn is not None
    outputs = tuple(np.zeros((count, padded, padded)) for count in (groups, turns * groups))
    own = full.copy()
    own[table.mount] = 0.0
    nothing = np.zeros(0)
    inputs = (
        *vars(points.turned).values(),
        points.centers,
        points.weight,
        points.start,
        *_model(arm, table, own),
        *_joint_terms(arm, flange, table, own, points.joints),
        points.position,
        points.turn_weight if turns else nothing,
        points.turn if turns else nothing,
    )
    _spread(
        points.start, lambda first, last: _kernel.accumulate_points(inputs, outputs, first, last)
    )
    # only the upper triangle is summed
    position, turn = (
        np.triu(each) + np.swapaxes(np.triu(each, 1), 1, 2)
        for each in (found[:, :columns, :columns] for found in outputs)
    )
    return position, turn if turns else None


def _padded(columns: int) -> int:
    return -(-columns // TILE) * TILE


def _model(arm: Arm, table: ParameterTable, full: Array) -> tuple[Array | IntArray, ...]:
    """Geometry, directions, which joints slide, the mount, and the free columns."""
    place, turn = full[table.mount].reshape(2, 3)
    mount = np.concatenate(
        [
            rotation_matrix(turn).reshape(-1),
            place,
            left_jacobian(turn).T.reshape(-1),
            *(
                part
                for end in (arm.base_T_dh, arm.dh_T_flange)
                for part in (end.rotation.reshape(-1), end.translation)
            ),
        ]
    )
    return (
        np.ascontiguousarray(full[: 5 * table.n]),
        np.ascontiguousarray(arm.direction, dtype=np.float64),
        np.where(arm.prismatic, np.cumsum(arm.prismatic) - 1, -1).astype(np.int64),
        mount,
        table.free_columns,
    )


def _joint_terms(
    arm: Arm, probe: Probe, table: ParameterTable, full: Array, joints: Array
) -> tuple[Array, Array]:
    """The joint errors' values (T, n), and the last E of their functions (E, n, N), the ones that
    are no harmonics."""
    errors = table.joint_errors(full)
    if errors is None:
        return np.zeros((0, table.n)), np.zeros(0)
    values = np.ascontiguousarray(errors.values)
    others = replace(errors.terms, harmonics=0)
    if not others.count:
        return values, np.zeros(0)
    applied, _ = table.apply(full, arm, probe)
    return values, np.ascontiguousarray(others.basis(applied, joints).transpose(1, 2, 0))


def _spread(start: IntArray, run: Callable[[int, int], None]) -> None:
    """`run` over all groups, each thread about as many rows, the last of them here."""
    bounds = _shares(start).tolist()
    *others, own = zip(bounds[:-1], bounds[1:], strict=True)
    beside = [Thread(target=run, args=share) for share in others]
    for thread in beside:
        thread.start()
    try:
        run(*own)
    finally:
        for thread in beside:
            thread.join()


def _shares(start: IntArray) -> IntArray:
    """Bounds between groups that give each thread about as many rows."""
    before, rows, groups = int(start[0]), int(start[-1] - start[0]), len(start) - 1
    parts = max(min(threads(), rows // POSES_PER_THREAD, groups), 1)
    inner = np.searchsorted(start, before + rows * np.arange(1, parts) / parts)
    return np.unique(np.concatenate([[0], inner, [groups]])).astype(np.int64)
