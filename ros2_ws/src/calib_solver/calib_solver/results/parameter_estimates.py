# SPDX-License-Identifier: Apache-2.0
"""What is said of each parameter: was it told by the poses, how surely, and in one sentence why."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.kinematics import Parameter
from calib_solver.identification import Identification

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


def estimates_of(done: Identification) -> list[ParameterEstimate]:
    """Every parameter in use, in the table's order."""
    free = {parameter.name: i for i, parameter in enumerate(done.table.free)}
    found = []
    for parameter, value in zip(done.table.parameters, done.full, strict=True):
        if parameter.name in free:
            found.append(_free(done, parameter, float(value), free[parameter.name]))
        elif parameter.kind != 'beta' or parameter.nominal != 0.0:
            found.append(ParameterEstimate(parameter, float(value), None, False, parameter.reason))
    return found


def _free(
    done: Identification, parameter: Parameter, value: float, index: int
) -> ParameterEstimate:
    unseen = parameter.reason or done.observability.reason[index]
    if unseen:
        return ParameterEstimate(parameter, value, None, False, unseen)
    uncertainty = float(done.uncertainty.standard[index])
    prior = done.options.prior
    before = prior.sigma[parameter.kind] * prior.times.get(parameter.kind, 1.0)
    size = quantity(uncertainty, parameter.unit)
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
