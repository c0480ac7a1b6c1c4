# SPDX-License-Identifier: Apache-2.0
"""What the data could tell of the free parameters: rank, weak directions, who is in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.parameters import ParameterTable
from calib_model.rotation import Array
from calib_solver.levenberg import RANK_TOLERANCE, Fit
from calib_solver.prior import Prior

#: a parameter is in an unseen direction when this part of it lies there
SHARE = 0.1


@dataclass(frozen=True)
class Observability:
    """`rank` of F free parameters, `condition` of the scaled J, `identifiable` (F,) and, for each
    parameter that is not, `reason` (F,)."""

    rank: int
    condition: float
    identifiable: tuple[bool, ...]
    reason: tuple[str, ...]


def observe(table: ParameterTable, fit: Fit, prior: Prior) -> Observability:
    """The singular value decomposition of J, columns in units of the prior's sigmas.

    These units are a parameter's natural size; columns scaled to unit length would make one of
    pure rounding look as good as the others.
    """
    names = [parameter.name for parameter in table.free]
    if not names:
        return Observability(0, 1.0, (), ())
    scale = prior.sigmas(table)
    values, vectors = np.linalg.eigh(scale[:, None] * fit.quadratic.normal * scale)
    largest = max(float(values[-1]), 1e-300)
    unseen = vectors[:, values <= RANK_TOLERANCE * largest]
    share = (unseen**2).sum(axis=1)
    reasons = [_reason(names, unseen, i) if share[i] > SHARE else '' for i in range(len(names))]
    smallest = max(float(values[0]), 0.0)
    condition = float(np.sqrt(largest / smallest)) if smallest > 0 else float('inf')
    return Observability(
        len(names) - unseen.shape[1], condition, tuple(not reason for reason in reasons),
        tuple(reasons),
    )  # fmt: skip


def _reason(names: list[str], unseen: Array, index: int) -> str:
    """With whom a parameter hides: the others of the unseen direction it is most part of."""
    direction = unseen[:, int(np.argmax(np.abs(unseen[index])))]
    others = [names[i] for i in np.argsort(-np.abs(direction)) if abs(direction[i]) > SHARE]
    others = [name for name in others if name != names[index]][:4]
    if not others:
        return f'{names[index]} changes nothing that was measured'
    return f'{names[index]} can be traded against {", ".join(others)} without any residual changing'
