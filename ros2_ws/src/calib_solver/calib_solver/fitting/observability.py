# SPDX-License-Identifier: Apache-2.0
"""What the data could tell of the free parameters: rank, weak directions, who is in them; and what
is said of each parameter: was it told, how surely, and in one sentence why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array
from calib_model.kinematics import Parameter, ParameterTable
from calib_solver.fitting.levenberg_marquardt import Fit, modes
from calib_solver.fitting.prior import Prior
from calib_solver.fitting.uncertainty import Uncertainty

#: a parameter is in an unseen direction when this part of it lies there
SHARE = 0.1
#: directions that the poses tell this many times worse than the best one are weak
WEAK = 1e6
#: more weak directions, and more parameters in one, than this are not named
MOST_WEAKEST = 3
MOST_MEMBERS = 4
#: a parameter whose uncertainty stays above this part of the prior's sigma was not told
TOLD = 0.7


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


@dataclass(frozen=True)
class ParameterEstimate:
    """A parameter with its value before and after; `standard_uncertainty` None when not known."""

    parameter: Parameter
    identified: float
    standard_uncertainty: float | None
    identifiable: bool
    reason: str


def estimates_of(
    table: ParameterTable,
    full: Array,
    observability: Observability,
    uncertainty: Uncertainty,
    prior: Prior,
) -> tuple[ParameterEstimate, ...]:
    """Every parameter in use, in the table's order; `full` (C,) are the identified columns."""
    row_of = {parameter.name: i for i, parameter in enumerate(table.free)}
    found = []
    for parameter, value in zip(table.parameters, full.tolist(), strict=True):
        row = row_of.get(parameter.name)
        if row is not None:
            unseen = parameter.reason or observability.reason[row]
            standard = float(uncertainty.standard[row])
            found.append(_free(parameter, value, unseen, standard, prior))
        elif parameter.kind != 'beta' or parameter.nominal != 0.0:
            found.append(ParameterEstimate(parameter, value, None, False, parameter.reason))
    return tuple(found)


def _free(
    parameter: Parameter, value: float, unseen: str, uncertainty: float, prior: Prior
) -> ParameterEstimate:
    if unseen:
        return ParameterEstimate(parameter, value, None, False, unseen)
    size = quantity(uncertainty, parameter.unit)
    before = prior.sigma[parameter.kind] * prior.times.get(parameter.kind, 1.0)
    if prior.strength > 0 and uncertainty > TOLD * before:
        reason = f'the poses tell it hardly better ({size}) than the prior did'
        return ParameterEstimate(parameter, value, uncertainty, False, reason)
    return ParameterEstimate(parameter, value, uncertainty, True, f'told by the poses to {size}')


def quantity(value: float, unit: str) -> str:
    """A length in mm, an angle in mrad, a compliance in urad/(N m), a scale in um/m, for people."""
    if unit in ('rad/(N m)', 'm/m'):
        return f'{value * 1e6:.2g} u{unit}'
    return f'{value * 1e3:.2g} {"mm" if unit == "m" else "mrad"}'
