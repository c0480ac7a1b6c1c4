# SPDX-License-Identifier: Apache-2.0
"""An arm with everything that was identified of it: D-H parameters and what they cannot say."""

from __future__ import annotations

from dataclasses import dataclass

from calib_model.arm import Arm
from calib_model.correction import Correction
from calib_model.kinematics import forward, points
from calib_model.rotation import Array


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
        T_base_flange = forward(self.arm, self.joints(q))
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
