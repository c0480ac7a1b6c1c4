# SPDX-License-Identifier: Apache-2.0
"""What is reported of repetitions: each method's uncertainties beside the stated ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

import numpy as np

from calib_model.arrays import Array
from calib_solver.fitting import ParameterEstimate, Workspace
from calib_solver.results.quality import Record

if TYPE_CHECKING:
    from calib_solver.resampling import Repeated, Resampled

METHODS = ('monte_carlo', 'bootstrap')


class Repeatable(Protocol):
    """An identification of either kind, as far as repetitions go."""

    @property
    def estimates(self) -> tuple[ParameterEstimate, ...]:
        """What is said of every parameter."""
        ...

    @property
    def workspace(self) -> Workspace:
        """Postures all over the workspace, and how points there go with what is drawn."""
        ...


def resampling_record(done: Repeatable, resampled: Resampled) -> Record:
    """What `result.json` says under `resampling`, SI; null for a method that was not asked for.

    Only free parameters are listed; `analytic` is null where the parameter's own
    `standard_uncertainty` is.
    """
    found = {method: getattr(resampled, method) for method in METHODS}
    free = [estimate for estimate in done.estimates if estimate.parameter.free]
    parameters = []
    for i, estimate in enumerate(free):
        sizes = {method: _size(repeated, i) for method, repeated in found.items()}
        parameters.append(
            {
                'name': estimate.parameter.name,
                'unit': estimate.parameter.unit,
                'analytic': estimate.standard_uncertainty,
                **sizes,
            }
        )
    return {
        'seed': resampled.plan.seed,
        **{method: _method_record(done, repeated) for method, repeated in found.items()},
        'parameters': parameters,
    }


def _size(repeated: Repeated | None, index: int) -> float | None:
    return None if repeated is None else float(repeated.standard[index])


def _method_record(done: Repeatable, repeated: Repeated | None) -> Record | None:
    if repeated is None:
        return None
    return {
        'repetitions': len(repeated.deviation),
        'converged': repeated.converged,
        'seconds': repeated.seconds,
        'position_uncertainty_rms': _rms(done.workspace.uncertainty(repeated.covariance)),
        'ratio_to_analytic': _ratio(done, repeated),
    }


def _ratio(done: Repeatable, repeated: Repeated) -> float | None:
    """The median over the identifiable parameters of the method's uncertainty to the stated."""
    stated = [
        estimate.standard_uncertainty if estimate.identifiable else None
        for estimate in done.estimates
        if estimate.parameter.free
    ]
    sizes = repeated.standard[: len(stated)]
    ratios = [size / said for size, said in zip(sizes, stated, strict=True) if said]
    return float(np.median(ratios)) if ratios else None


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def resampling_lines(record: Record, over: str = 'locations') -> list[str]:
    """A line for each method that was asked for, and what it says against the stated ones; the
    bootstrap drew `over` these."""
    lines = []
    for method, name in zip(METHODS, ('Monte Carlo', f'bootstrap over {over}'), strict=True):
        found = record[method]
        if found is None:
            continue
        line = (
            f'{name}, {found["repetitions"]} repetitions: '
            f'{found["position_uncertainty_rms"] * 1e3:.4f} mm rms over the workspace'
        )
        if found['ratio_to_analytic'] is not None:
            line += f', parameters {found["ratio_to_analytic"]:.2f} times as unsure as stated'
        if found['converged'] < found['repetitions']:
            line += f'; {found["repetitions"] - found["converged"]} did not converge'
        lines.append(line)
    return lines
