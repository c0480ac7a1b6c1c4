# SPDX-License-Identifier: Apache-2.0
"""What is corrected beyond the D-H parameters: joint errors, and the functions of eq. 12."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib_model.arrays import Array, frozen
from calib_model.errors import DataError
from calib_model.instruments import Arm
from calib_model.kinematics.forward import forward_kinematics, points
from calib_model.kinematics.joint_errors import JointErrors, harmonic_basis


@dataclass(frozen=True, eq=False)
class Shift:
    """A harmonic series in every joint for each coordinate of the base frame, m.

    `values` (2 K, 3, n): cosine and sine, in turn, of 1 .. K times each joint's angle.
    """

    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'values', frozen(self.values))

    def at(self, q: Array) -> Array:
        """The shift (N, 3), m, at postures q (N, n), rad."""
        basis = harmonic_basis(q, len(self.values) // 2)
        shift: Array = np.einsum('ntj,tkj->nk', basis, self.values)
        return shift


@dataclass(frozen=True, eq=False)
class Attitude:
    """For each coordinate of the base frame a sum of how the flange is turned, m.

    `values` (3, 3, 3): of coordinate c with element (a, b) of the flange's rotation in the base.
    A gauge that yields to a probe moves with the direction it is pushed from.
    """

    values: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, 'values', frozen(self.values))

    def at(self, arm: Arm, q: Array) -> Array:
        """The shift (N, 3), m, at postures q (N, n), rad."""
        shift: Array = np.einsum('nab,cab->nc', forward_kinematics(arm, q)[:, :3, :3], self.values)
        return shift


@dataclass(frozen=True, eq=False)
class Correction:
    """What to add to the D-H model of the arm with these joints.

    `joint_errors` were identified together with the parameters. The correction of eq. 12, found
    afterwards from what was left, is f(q) = p(q + turn(q)) - p(q) + shift(q) + attitude(q): `turn`
    says what follows a joint's lever over the workspace, `shift` what does not, and `attitude`
    what depends on how the probe is held.
    """

    joint_names: tuple[str, ...]
    joint_errors: JointErrors | None = None
    turn: JointErrors | None = None
    shift: Shift | None = None
    attitude: Attitude | None = None

    @classmethod
    def identified(cls, names: tuple[str, ...], errors: JointErrors | None) -> Correction | None:
        """Of joint errors identified together with the parameters; None without any."""
        return cls(names, errors) if errors is not None else None

    def checked(self, arm: Arm) -> Correction:
        """Itself, when it is one for `arm`.

        Raises:
            DataError: the joints are other ones.
        """
        if self.joint_names != arm.joint_names:
            raise DataError(
                f'correction: is for joints {", ".join(self.joint_names)}, '
                f'{arm.name} has {", ".join(arm.joint_names)}'
            )
        return self

    def joints(self, arm: Arm, q: Array) -> Array:
        """Where the joints are (N, n), rad, when the encoders read q (N, n).

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        there = arm.check_joints(q)
        for errors in (self.joint_errors, self.turn):
            if errors is not None:
                there = there + errors.angles(arm, q)
        return there

    def shifts(self, arm: Arm, q: Array) -> Array:
        """What is added to the position of the probed point (N, 3), m, base frame.

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        q = arm.check_joints(q)
        added: Array = np.zeros((len(q), 3))
        if self.shift is not None:
            added += self.shift.at(q)
        if self.attitude is not None:
            added += self.attitude.at(arm, q)
        return added


@dataclass(frozen=True, eq=False)
class CorrectedArm:
    """`arm` as identified with its `correction`; None is the D-H model alone."""

    arm: Arm
    correction: Correction | None = None

    def __post_init__(self) -> None:
        if self.correction is not None:
            self.correction.checked(self.arm)

    def joints(self, q: Array) -> Array:
        """Where the joints are (N, n), rad, when the encoders read q (N, n).

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        if self.correction is None:
            return self.arm.check_joints(q)
        return self.correction.joints(self.arm, q)

    def forward(self, q: Array) -> Array:
        """`T_base_flange` (N, 4, 4) of postures q (N, n) as the encoders read them.

        What eq. 12 shifts was found for the probed point; it moves the flange as it is.

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        T_base_flange = forward_kinematics(self.arm, self.joints(q))
        if self.correction is not None:
            T_base_flange[:, :3, 3] += self.correction.shifts(self.arm, q)
        return T_base_flange

    def points(self, q: Array, p_flange: Array) -> Array:
        """`p_base` (N, 3) of points `p_flange` (3,) or (N, 3) of the flange, m: eq. 9, corrected.

        Raises:
            DataError: `q` has not the arm's number of joints.
        """
        p_base = points(self.arm, self.joints(q), p_flange)
        if self.correction is None:
            return p_base
        return p_base + self.correction.shifts(self.arm, q)
