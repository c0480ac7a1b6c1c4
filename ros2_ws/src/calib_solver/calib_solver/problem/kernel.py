# SPDX-License-Identifier: Apache-2.0
"""The compiled pass over the poses, on all cores; without it numpy does the same, slower."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import ParameterError
from calib_model.kinematics import ParameterTable
from calib_model.transforms import left_jacobian, rotation_matrix
from calib_solver.problem.problem import IntArray, Problem

try:
    from calib_solver.problem import _kernel
except ImportError:  # not compiled here
    _kernel = None  # type: ignore[assignment, unused-ignore]

MOST_JOINTS = 16
MOST_TERMS = 9  # of joint errors
TILE = 4
#: below this many poses a second thread costs more than it saves
POSES_PER_THREAD = 2000


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


def available(problem: Problem, table: ParameterTable) -> bool:
    """Whether the compiled pass is there and takes such an arm."""
    terms = 0 if table.joint_terms is None else table.joint_terms.count
    fits = len(problem.cosine) <= MOST_JOINTS and terms <= MOST_TERMS
    return _kernel is not None and fits


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


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads(), 'calib_solver')


def raw_sums(problem: Problem, table: ParameterTable, full: Array) -> RawSums:
    """The sums at the parameters `full`, sphere by sphere: independent of the number of threads."""
    spheres, free = len(problem.keys), len(table.free_columns)
    padded = -(-(free + 1) // TILE) * TILE
    raw = RawSums(
        np.zeros(spheres),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3)),
        np.zeros((spheres, 3, free)),
        np.zeros((spheres, padded, padded)),
    )
    outputs = tuple(vars(raw).values())
    size = 5 * table.n
    arm = problem.measured.arm
    place, turn = full[table.mount].reshape(2, 3)
    values, torque = _joint_terms(problem, table, full)
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
    inputs = (
        problem.cosine,
        problem.sine,
        problem.slide,
        problem.centers,
        problem.weight,
        problem.start,
        np.ascontiguousarray(full[:size]),
        np.ascontiguousarray(arm.direction, dtype=np.float64),
        np.where(arm.prismatic, np.cumsum(arm.prismatic) - 1, -1).astype(np.int64),
        mount,
        table.free_columns,
        values,
        torque,
    )
    bounds = _shares(problem)
    if len(bounds) == 2:
        _kernel.accumulate(inputs, outputs, 0, spheres)
        return raw
    shares = [
        _pool().submit(_kernel.accumulate, inputs, outputs, int(first), int(last))
        for first, last in zip(bounds[:-1], bounds[1:], strict=True)
    ]
    for share in shares:
        share.result()
    return raw


def _joint_terms(problem: Problem, table: ParameterTable, full: Array) -> tuple[Array, Array]:
    """The joint errors' values (T, n), and the torques (n, N) where compliance is among them."""
    errors = table.joint_errors(full)
    if errors is None:
        return np.zeros((0, table.n)), np.zeros(0)
    values = np.ascontiguousarray(errors.values)
    if errors.terms.links is None:
        return values, np.zeros(0)
    arm, _ = table.apply(full, problem.measured.arm, problem.measured.probe)
    torque = replace(errors.terms, harmonics=0).basis(arm, problem.joints)[:, 0]
    return values, np.ascontiguousarray(torque.T)


def _shares(problem: Problem) -> IntArray:
    """Bounds between spheres that give each thread about as many poses."""
    poses = int(problem.start[-1])
    parts = max(min(threads(), poses // POSES_PER_THREAD, len(problem.keys)), 1)
    inner = np.searchsorted(problem.start, poses * np.arange(1, parts) / parts)
    return np.unique(np.concatenate([[0], inner, [len(problem.keys)]])).astype(np.int64)
