# SPDX-License-Identifier: Apache-2.0
"""What is said of each parameter: was it told by the poses, how surely, and in one sentence why."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.arrays import Array
from calib_model.kinematics import Parameter, ParameterTable
from calib_solver.fitting.observability import Observability
from calib_solver.fitting.prior import Prior
from calib_solver.fitting.uncertainty import Uncertainty

#: a parameter whose uncertainty stays above this part of the prior's sigma was not told
TOLD = 0.7


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
    reason = f'told by the poses to {size}'
    if prior.strength > 0 and uncertainty > 0:
        times = before / uncertainty
        shown = f'{times:,.0f}' if times >= 100 else f'{times:.3g}'
        reason += f', {shown} times better than by the prior'
    return ParameterEstimate(parameter, value, uncertainty, True, reason)


def quantity(value: float, unit: str) -> str:
    """A length in mm, an angle in mrad or a compliance in urad/(N m), for people."""
    if unit == 'rad/(N m)':
        return f'{value * 1e6:.3g} urad/(N m)'
    return f'{value * 1e3:.3g} {"mm" if unit == "m" else "mrad"}'
