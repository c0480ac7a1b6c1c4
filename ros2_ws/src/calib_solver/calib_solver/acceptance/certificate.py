# SPDX-License-Identifier: Apache-2.0
"""The gauge's certificate as a source of errors that two measurements may have in common."""

from __future__ import annotations

import numpy as np

from calib_model.arrays import Array
from calib_model.instruments import Gauge

#: m: centres nearer to one another are of one certificate
SAME = 1e-9


def same_certificate(first: Gauge | None, second: Gauge | None) -> bool:
    """Whether both are one gauge with one certificate, at whatever temperature."""
    if first is None or second is None:
        return False
    one, other = first.as_certified(), second.as_certified()
    return bool(
        (one.name, one.numbers) == (other.name, other.numbers)
        and np.allclose(_centers(one), _centers(other), rtol=0, atol=SAME)
        and np.isclose(one.constant, other.constant, rtol=1e-9, atol=0)
        and np.isclose(one.proportional, other.proportional, rtol=1e-6, atol=1e-12)
    )


def certificate_roots(slope: Array, gauge: Gauge | None) -> dict[str, Array]:
    """Columns (R, k) whose squares add up to the covariance of R errors that are `slope` (R, 3K)
    times that of the coordinates of the gauge's spheres (m), by what they come from.

    `spheres` and `scale` are the certificate's, `expansion` the gauge's coefficient: these are the
    same whenever the gauge is used. `temperature` is of one day. Without a gauge there are none.
    """
    if gauge is None:
        return {'none': np.zeros((len(slope), 0))}
    certified = gauge.as_certified()
    along = _centers(gauge) - _centers(gauge).mean(axis=0)
    by_scale = slope @ along.reshape(-1, 1)
    roots = {
        'spheres': slope * (gauge.constant / 2 / np.sqrt(2)),
        'scale': by_scale * (certified.proportional / 2),
    }
    if gauge.scale is not None and gauge.expansion is not None:
        above = gauge.scale.temperature - gauge.expansion.reference
        roots['expansion'] = by_scale * (gauge.expansion.uncertainty * above)
        own = gauge.expansion.coefficient * gauge.temperature_uncertainty
        roots['temperature'] = by_scale * own
    return roots


def together(first: dict[str, Array], second: dict[str, Array], same: bool) -> Array:
    """The columns (R, k) of the sum of two errors; with the `same` certificate they are one in
    what the certificate and the coefficient make of them."""
    columns = []
    for name in {**first, **second}:
        parts = [roots[name] for roots in (first, second) if name in roots]
        if same and name != 'temperature' and len(parts) == 2:
            parts = [parts[0] + parts[1]]
        columns += parts
    return np.concatenate(columns, axis=1)


def _centers(gauge: Gauge) -> Array:
    return np.array([center for _, center in gauge.spheres])
