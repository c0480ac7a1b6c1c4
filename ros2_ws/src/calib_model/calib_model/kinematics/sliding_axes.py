# SPDX-License-Identifier: Apache-2.0
"""What joints that slide leave untold: only the direction of such an axis counts, not its place.

Moving the line of a sliding axis moves what follows it as other lengths do, and where the first
joint slides, all that follows as the base does. Which lengths are left over depends on the axes
around it, so that it is asked of the Jacobian at postures anyhow, by exact linear dependence.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib_model.arrays import Array
from calib_model.instruments import JOINT_PARAMETERS, Arm, PassiveProbe, Probe
from calib_model.kinematics.jacobian import probing_jacobian
from calib_model.kinematics.parameters import ParameterTable
from calib_model.transforms import skew

POSTURES = 80
OFF_PROBE = 0.1  # m: how far off the probe's origin points are
#: the part of a column that no other column tells is rounding below this
DEPENDENT = 1e-8
#: a column says so much (of the largest share) in what tells the same, or is not named
NAMED = 1e-3
BASE = tuple(f'base_{axis}' for axis in ('x', 'y', 'z', 'rx', 'ry', 'rz'))


def freeze_dependent(
    table: ParameterTable, arm: Arm, probe: Probe, parallel: Sequence[int]
) -> ParameterTable:
    """The table with every free parameter frozen that others, or the base, tell already, and why.

    `parallel` are joints, from 1, whose axis is nearly parallel to the next one's. Kept first are
    the probe's mount and what turns; a and d of the joint before a sliding one, which place its
    line, are tried last.
    """
    columns, jacobian = _columns(table, _straightened(arm, parallel), probe)
    names = (*BASE, *(table.names[column] for column in columns))
    kept: list[int] = list(range(len(BASE)))
    for place in range(len(BASE), len(names)):
        others, own = jacobian[:, kept], jacobian[:, place]
        share, *_ = np.linalg.lstsq(others, own, rcond=None)
        if np.linalg.norm(own - others @ share) > DEPENDENT * np.linalg.norm(own):
            kept.append(place)
            continue
        reason = _reason(names[place], [names[i] for i in kept], share)
        table = table.frozen_at([columns[place - len(BASE)]], reason)
    return table


def _columns(table: ParameterTable, arm: Arm, probe: Probe) -> tuple[list[int], Array]:
    """The free columns, those to be kept first, and the Jacobian (M, 6 + F) by them, behind that by
    motions of the base."""
    generator = np.random.default_rng(0)
    lower, upper = arm.ranges.T
    q = generator.uniform(lower, upper, (POSTURES, arm.n))
    p_probe = generator.uniform(-OFF_PROBE, OFF_PROBE, (POSTURES, 3))
    if isinstance(probe, PassiveProbe):
        p_probe = np.tile(probe.center, (POSTURES, 1))
    point, jacobian = probing_jacobian(arm, probe, q, p_probe)
    placing = {
        table.column(f'{key}{joint}')
        for joint in np.flatnonzero(arm.prismatic)
        if joint > 0
        for key in ('a', 'd')
    }
    mount = range(table.mount.start, table.mount.stop)
    order = sorted(table.free_columns.tolist(), key=lambda i: (i not in mount, i in placing, i))
    moved = np.concatenate([np.broadcast_to(np.eye(3), (POSTURES, 3, 3)), -skew(point)], axis=2)
    both = np.concatenate([moved, jacobian[:, :, order]], axis=2)
    return order, both.reshape(3 * POSTURES, -1)


def _straightened(arm: Arm, parallel: Sequence[int]) -> Arm:
    """The arm with axes exactly parallel that nearly are: what they tell, they tell hardly."""
    geometry = np.array(arm.geometry)
    alpha, beta = (JOINT_PARAMETERS.index(key) for key in ('alpha', 'beta'))
    for joint in parallel:
        geometry[alpha, joint - 1] = np.round(geometry[alpha, joint - 1] / np.pi) * np.pi
        geometry[beta, joint - 1] = 0.0
    return arm.with_geometry(geometry)


def _reason(name: str, others: Sequence[str], share: NDArray[np.floating[Any]]) -> str:
    largest = np.abs(share).max(initial=0.0)
    if largest == 0:
        return f'{name} moves nothing that is probed'
    told = [other for other, part in zip(others, share, strict=True) if abs(part) > NAMED * largest]
    if all(other in BASE for other in told):
        return f'{name} moves the whole arm with its base frame: no probing shows it'
    by = ', '.join('the base' if other in BASE else other for other in told)
    return f'{name} shows only together with {by}, next to a joint that slides'
