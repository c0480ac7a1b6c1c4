# SPDX-License-Identifier: Apache-2.0
"""What a result's user is to doubt first: lines on what residuals and parameters look like."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Arm, Probe
from calib_model.kinematics import ParameterTable
from calib_model.measurement import Measurement
from calib_solver.faults.fault_signatures import named_signatures
from calib_solver.faults.gross_errors import SLIPPED, Rejected
from calib_solver.faults.mixups import beyond_belief, named_mixups
from calib_solver.fitting import Solver
from calib_solver.problem import Problem
from calib_solver.quality import Quality, assess

#: a pose's usual distance from its sphere's centre (m) below which nothing is mixed up
SMALL = 3e-4
#: unless so many of the poses had to be left out to get there
LEFT_OUT = 0.02
#: a parameter so many times further from its nominal value than is usual is not this arm's
FAR = 10.0
#: as long as it is told from nominal at all: so many times its own uncertainty
TOLD = 5.0
NAMED = 3
#: a parameter whose uncertainty stays above this part of what it is off anyway was not told
UNTOLD = 0.7


def pose_warnings(
    measured: Measurement,
    problem: Problem,
    solver: Solver,
    arm: Arm,
    probe: Probe,
    quality: Quality,
    rejected: Sequence[Rejected],
    far: bool = False,
) -> tuple[str, ...]:
    """Lines on what the residuals look like: something mixed up, or a fault's shadow.

    `measured` is all that was measured, `problem` what is left of it without the `rejected`, and
    `quality` its own; `solver` solves for what may have been mixed up; `far` says that parameters
    are where a mix-up may have taken them.
    """
    slipped = sum(one.reason == SLIPPED for one in rejected)
    mixed_up: tuple[str, ...] = ()
    if far or quality.spread > SMALL or slipped > LEFT_OUT * len(measured.poses):
        of_all = assess(Problem.of(measured), arm, probe) if rejected else quality
        mixed_up = named_mixups(measured, of_all.spread, solver, far)
    out = [one.pose - 1 for one in rejected]
    pose_of = np.setdiff1d(np.arange(len(measured.poses)), out)
    return (
        mixed_up
        or named_signatures(problem, solver.table, arm, probe, pose_of)
        or beyond_belief(quality.spread)
    )


def distance_warnings(
    name: str, initial: Quality, identified: Quality, width: Array, uncertainty: Array
) -> tuple[str, ...]:
    """A line where distances alone, objective `name`, tell too little to be used.

    `uncertainty` (F,) is that of the free parameters, `width` (F,) what they are off without any
    pose, m and rad.
    """
    if name != 'distance':
        return ()
    untold = int((uncertainty > UNTOLD * width).sum())
    grown = identified.spread / max(initial.spread, SMALL)
    said = []
    if grown > 1:
        said.append(f'the poses of one sphere lie {grown:.1f} times as far apart as before')
    if 2 * untold > len(width):
        said.append(f'{untold} of {len(width)} parameters are hardly told')
    if not said:
        return ()
    return (f'distances alone do not do here: {", ".join(said)}; eq. 11 looks at the poses too',)


def parameter_warnings(
    table: ParameterTable, full: Array, sigma: Array, uncertainty: Array
) -> tuple[str, ...]:
    """A line on what has gone further from nominal than arms of one make do.

    `full` (C,) are all parameters, `sigma` (F,) what the free ones usually are off by and
    `uncertainty` (F,) their standard deviations. The probe's mount may be anywhere.
    """
    change = (full - table.nominal)[table.free_columns]
    times = np.abs(change) / sigma
    far = (times > FAR) & (np.abs(change) > TOLD * uncertainty)
    far &= table.of_arm
    rows = [row for row in np.argsort(-times, kind='stable') if far[row]]
    if not rows:
        return ()
    named = []
    for row in rows[:NAMED]:
        parameter = table.free[row]
        unit = 'mm' if parameter.unit == 'm' else 'mrad'
        named.append(f'{parameter.name} by {change[row] * 1e3:+.3f} {unit}')
    more = f' and {len(rows) - NAMED} more' if len(rows) > NAMED else ''
    return (
        f'further from nominal than {FAR:.0f} times what is usual: {", ".join(named)}{more}: is '
        "the description this arm's, are its joints mastered? The stated uncertainty counts on "
        'parameters as far off as that',
    )
