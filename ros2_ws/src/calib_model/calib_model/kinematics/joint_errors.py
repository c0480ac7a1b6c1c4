# SPDX-License-Identifier: Apache-2.0
"""What Denavit-Hartenberg parameters cannot say of a joint: its encoder's harmonics, its give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.instruments import Arm
from calib_model.kinematics.gravity import Links, gravity_torques

#: an eccentric disc errs once per turn, an oval one or two read heads twice
ENCODER_HARMONICS = 2
ENCODER, SCALE, COMPLIANCE = 'encoder', 'scale', 'compliance'
KINDS = (ENCODER, SCALE, COMPLIANCE)


def harmonic_basis(q: Array, harmonics: int) -> Array:
    """cos(q), sin(q), cos(2 q), .. of every joint of q (N, n), shape (N, 2 harmonics, n)."""
    order = np.arange(1, harmonics + 1)[:, None]
    turned = order * q[:, None, :]
    basis: Array = np.stack([np.cos(turned), np.sin(turned)], axis=2)
    return basis.reshape(len(q), 2 * harmonics, q.shape[1])


@dataclass(frozen=True, eq=False)
class JointTerms:
    """Functions of the posture by which a joint may be off what its encoder reads.

    Per joint j that turns: cos(k q_j) and sin(k q_j) for k = 1 .. `harmonics` and, with `links`,
    the torque of gravity. Per joint that slides, with `scale`: q_j, metres for a metre told. All
    are functions of the positions as read, q_j that of the joint itself where it is coupled to
    another; they are zero for joints of the other type.
    """

    harmonics: int = 0
    links: Links | None = None
    scale: bool = False

    @property
    def count(self) -> int:
        """Functions per joint."""
        return 2 * self.harmonics + self.scale + (self.links is not None)

    @property
    def names(self) -> tuple[tuple[str, str, str], ...]:
        """Kind, name less the joint's number, and unit of each function."""
        rows = []
        for order in range(1, self.harmonics + 1):
            rows += [(ENCODER, f'encoder_{part}{order}_', 'rad') for part in ('cos', 'sin')]
        if self.scale:
            rows.append((SCALE, 'scale_', 'm/m'))
        if self.links is not None:
            rows.append((COMPLIANCE, 'compliance_', 'rad/(N m)'))
        return tuple(rows)

    def basis(self, arm: Arm, q: Array) -> Array:
        """The functions (N, count, n) at postures q (N, n): harmonics without unit, lengths in m,
        torques in N m.

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        turned = arm.uncoupled(q)
        basis = np.empty((len(turned), self.count, arm.n))
        basis[:, : 2 * self.harmonics] = harmonic_basis(turned, self.harmonics)
        if self.links is not None:
            basis[:, -1] = gravity_torques(arm, self.links, q)
        basis[:, :, arm.prismatic] = 0.0
        if self.scale:
            basis[:, 2 * self.harmonics] = np.where(arm.prismatic, turned, 0.0)
        return basis


@dataclass(frozen=True, eq=False)
class JointErrors:
    """Joints that have really moved by sum_t values[t] * basis_t(q) more; `values` (count, n), in
    rad, m/m for scale, or rad/(N m) for compliance."""

    terms: JointTerms
    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'values', frozen(self.values))

    def angles(self, arm: Arm, q: Array) -> Array:
        """How far the positions q (N, n) are off what is read (N, n), rad (m).

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        off: Array = np.einsum('ntj,tj->nj', self.terms.basis(arm, q), self.values)
        return arm.coupled(off)
