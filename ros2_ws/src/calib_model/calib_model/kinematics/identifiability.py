# SPDX-License-Identifier: Apache-2.0
"""Which parameters the data can tell at all: redundant ones are frozen by construction.

Rules of structure come first, because numbers mislead here: columns of zeros scaled to unit
length look observable. What is left is checked by SVD (`observability`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_model.instruments import JOINT_PARAMETERS, Arm, PassiveProbe, Probe
from calib_model.kinematics.parameters import ParameterTable
from calib_model.kinematics.sliding_axes import freeze_dependent

#: axes closer to parallel than this (rad) take Hayati's beta in place of d
NEARLY_PARALLEL = 0.05


def identifiable_table(
    arm: Arm, probe: Probe, fix: Sequence[str] = (), free: Sequence[str] = ()
) -> ParameterTable:
    """The table of an arm and its probe with what no probing can show frozen, and why.

    `fix` and `free` are names or patterns that the user freezes or frees all the same; `free`
    wins, and what no probing can show stays named as such.

    Raises:
        DataError: a pattern matches no parameter.
    """
    table = ParameterTable.of(arm, probe)
    table = _freeze_base(table)
    table = _freeze_flange(table, arm, probe)
    table = _use_hayati(table, arm)
    if arm.prismatic.any():
        table = freeze_dependent(table, arm, probe, parallel_joints(arm))
    freed = {column for pattern in free for column in table.matching(pattern)}
    fixed = {column for pattern in fix for column in table.matching(pattern)} - freed
    movable = [column for column in fixed if table.parameters[column].free]
    return table.frozen_at(movable, 'fixed by the user').freed(freed)


def parallel_joints(arm: Arm) -> list[int]:
    """Joints, counted from 1, whose axis is (nearly) parallel to the next one's."""
    alpha, beta = (arm.geometry[JOINT_PARAMETERS.index(key)] for key in ('alpha', 'beta'))
    crossing = np.sqrt(np.sin(alpha) ** 2 + np.sin(beta) ** 2)
    return [i for i in range(1, arm.n) if crossing[i - 1] < NEARLY_PARALLEL]


def _freeze_base(table: ParameterTable) -> ParameterTable:
    for name, motion in (('d1', 'lifts'), ('theta_0_1', 'turns')):
        reason = f'{name} {motion} the whole arm with its base frame: no probing shows it'
        table = table.frozen_at([table.column(name)], reason)
    return table


def _freeze_flange(table: ParameterTable, arm: Arm, probe: Probe) -> ParameterTable:
    last = arm.n
    names = [f'a{last}', f'alpha{last}', f'd{last}', f'theta_0_{last}']
    for name in names:
        reason = f'{name} moves the probe as its mount on the flange does: identified as the mount'
        table = table.frozen_at([table.column(name)], reason)
    if isinstance(probe, PassiveProbe):
        reason = 'a passive probe is one point of the flange: turning it shows nothing'
        table = table.frozen_at(table.matching('probe_r*'), reason)
    return table


def _use_hayati(table: ParameterTable, arm: Arm) -> ParameterTable:
    parallel = parallel_joints(arm)
    for joint in range(1, arm.n + 1):
        if joint not in parallel:
            reason = (
                f'axis {joint} is not parallel to the next: alpha{joint} and d{joint} say it all'
            )
            if joint == arm.n:
                reason = f'beta{joint} moves the probe as its mount on the flange does'
            table = table.frozen_at([table.column(f'beta{joint}')], reason)
    for joint in parallel:
        # along parallel axes one offset is enough: the first of them is held, and the axis'
        # second tilt is said by beta
        name = f'd{joint}' if not _from_base(joint, parallel) else f'd{joint + 1}'
        other = f'd{joint + 1}' if name == f'd{joint}' else f'd{joint}'
        reason = (
            f'axes {joint} and {joint + 1} are parallel: {name} shows only together with {other}'
        )
        table = table.frozen_at([table.column(name)], reason)
    return table


def _from_base(joint: int, parallel: list[int]) -> bool:
    """Whether all axes up to `joint` are parallel: then even the sum of their d is the base's."""
    return all(earlier in parallel for earlier in range(1, joint + 1))
