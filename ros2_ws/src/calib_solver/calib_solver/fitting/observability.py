# SPDX-License-Identifier: Apache-2.0
"""What the data could tell of the free parameters: rank, weak directions, who is in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import ParameterTable
from calib_solver.fitting.levenberg_marquardt import Fit, modes

#: a parameter is in an unseen direction when this part of it lies there
SHARE = 0.1
#: directions that the poses tell this many times worse than the best one are weak
WEAK = 1e6
#: more weak directions, and more parameters in one, than this are not named
MOST_WEAKEST = 3
MOST_MEMBERS = 4


@dataclass(frozen=True)
class Observability:
    """`rank` of the data among F free parameters, `condition` of the scaled J without the prior,
    and for each parameter that lies in an unseen direction the `reason` (F,), else ''. `weakest`
    says who is in the directions that are told worst, the worst first."""

    rank: int
    condition: float
    reason: tuple[str, ...]
    weakest: tuple[str, ...] = ()


def observe(table: ParameterTable, fit: Fit, scale: Array) -> Observability:
    """The singular value decomposition of J, columns in units of `scale` (F,), m and rad.

    These units are a parameter's natural size; columns scaled to unit length would make one of
    pure rounding look as good as the others.
    """
    names = [parameter.name for parameter in table.free]
    if not names:
        return Observability(0, 1.0, ())
    zero = np.zeros(len(names))
    found = modes(fit.quadratic, scale, zero, zero)
    unseen = found.vectors[:, ~found.seen]
    share = (unseen**2).sum(axis=1)
    reasons = tuple(
        _reason(names, unseen, i) if share[i] > SHARE else '' for i in range(len(names))
    )
    smallest = float(found.values[-1])
    condition = float(found.values[0]) / smallest if smallest > 0 else float('inf')
    weakest = tuple(
        ' with '.join(_members(names, found.vectors[:, -1 - i]))
        for i in range(min(MOST_WEAKEST, len(names)))
        if found.values[-1 - i] * WEAK < found.values[0]
    )
    return Observability(int(found.seen.sum()), condition, reasons, weakest)


def _members(names: list[str], direction: Array) -> list[str]:
    """Who makes up most of a direction, largest part first."""
    order = np.argsort(-np.abs(direction))[:MOST_MEMBERS]
    return [names[i] for i in order if abs(direction[i]) > SHARE]


def _reason(names: list[str], unseen: Array, index: int) -> str:
    """With whom a parameter hides: the others of the unseen direction it is most part of."""
    direction = unseen[:, int(np.argmax(np.abs(unseen[index])))]
    others = [names[i] for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > SHARE]
    others = [name for name in others if name != names[index]][:4]
    if not others:
        return f'{names[index]} changes nothing that was measured'
    return f'{names[index]} can be traded against {", ".join(others)} without any residual changing'
