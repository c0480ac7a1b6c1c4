# SPDX-License-Identifier: Apache-2.0
"""The branches of inverse kinematics: in closed form by EAIK where there is one, or numeric."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from calib_capture.motion.newton import NewtonInverse
from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import forward_kinematics

if TYPE_CHECKING:
    from eaik.IK_DH import DhRobot

EXACT = 1e-9  # m and rad: a solution is one when forward kinematics says so
SAME = 1e-6  # rad: closer postures are the same one
DECOMPOSED_JOINTS = 6
SWEPT = 2  # of seven joints: it turns the elbow, and most of its range can be used


class InverseError(CalibrationError):
    """An arm that cannot bring its flange to any pose."""


class InverseKinematics:
    """The postures of an arm that bring its flange to a given pose.

    Six joints with a spherical wrist or three parallel axes have a closed form, with every branch.
    Of seven joints the third is swept, where the others have a closed form: `redundant` (from 0).
    Every other arm, an identified one too, is solved by Newton's method: not every branch is
    found then, and `redundant` is None.

    Raises:
        InverseError: the arm has fewer than six joints or one that slides, or EAIK is not
            installed.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self._base_inverse = arm.base_T_dh.inverse().matrix()
        self._flange_inverse = arm.dh_T_flange.inverse().matrix()
        if arm.prismatic.any():
            slides = arm.joint_names[int(np.argmax(arm.prismatic))]
            raise InverseError(
                f'{arm.name}: {slides} slides: plan and capture take arms whose joints all turn'
            )
        if arm.n < DECOMPOSED_JOINTS:
            raise InverseError(
                f'{arm.name}: inverse kinematics needs at least 6 joints, got {arm.n}'
            )
        self.redundant: int | None = None
        self._six: DhRobot | None = None
        self._newton: NewtonInverse | None = None
        if not self._decomposed():
            self._newton = NewtonInverse(arm)

    def _decomposed(self) -> bool:
        """Whether there is a closed form; finds which joint is swept for it."""
        if np.any(self.arm.geometry[4] != 0.0):
            return False
        if self.arm.n == DECOMPOSED_JOINTS:
            self._six = self._solver([])
            return bool(self._six.hasKnownDecomposition())
        swept_alone = self.arm.n == DECOMPOSED_JOINTS + 1 and not self.arm.joints[SWEPT].coupling
        if swept_alone:
            self.redundant = SWEPT if self._solver([(SWEPT, 0.5)]).hasKnownDecomposition() else None
        return self.redundant is not None

    def _solver(self, fixed: list[tuple[int, float]]) -> DhRobot:
        try:  # rosdep has no key for it, and only planning needs it
            from eaik.IK_DH import DhRobot
        except ModuleNotFoundError as error:
            raise InverseError('this needs EAIK, not installed: pip install EAIK') from error
        a, alpha, d, _, _ = self.arm.geometry
        return DhRobot(alpha, a, d, fixed)

    def redundant_range(self) -> tuple[float, float]:
        """The range of the joint to be swept, rad; without meaning where none is."""
        lower, upper = np.clip(self.arm.limits[self.redundant or 0], -np.pi, np.pi)
        return float(lower), float(upper)

    def branches(self, T_base_flange: Array, redundant_value: float | None = None) -> Array:
        """Postures (K, n) in rad, each joint within +-pi, that reach the pose (4, 4).

        Limits are not applied. An arm of which a joint is swept needs the `redundant_value` (rad).
        """
        return self.branches_of([T_base_flange], [redundant_value])[0]

    def branches_of(
        self, T_base_flange: Sequence[Array], redundant_values: Sequence[float | None]
    ) -> list[Array]:
        """The same for each of several poses: together they take less time."""
        if self._newton is not None:
            found = self._newton.postures(np.array(T_base_flange))
        else:
            given = zip(T_base_flange, redundant_values, strict=True)
            found = [self._closed_form(pose, value) for pose, value in given]
        counts = [len(q) for q in found]
        q = _wrapped(np.concatenate(found))
        reaches = self._reaches(q, np.repeat(np.array(T_base_flange), counts, axis=0))
        ends = np.cumsum(counts)[:-1]
        return [
            _distinct(own[good])
            for own, good in zip(np.split(q, ends), np.split(reaches, ends), strict=True)
        ]

    def _closed_form(self, T_base_flange: Array, redundant_value: float | None) -> Array:
        solver = self._six
        if solver is None:
            assert self.redundant is not None
            if redundant_value is None:
                raise InverseError(f'{self.arm.name}: seven joints need a value for one of them')
            fixed = self.arm.direction[self.redundant] * redundant_value
            fixed -= self.arm.geometry[3, self.redundant]
            solver = self._solver([(self.redundant, float(fixed))])
        solution = solver.IK(self._base_inverse @ T_base_flange @ self._flange_inverse)
        theta = np.asarray(solution.Q, dtype=np.float64).reshape(-1, self.arm.n)
        # out of reach EAIK answers with the nearest posture, flagged as least squares
        theta = theta[~np.asarray(solution.is_LS, dtype=bool).reshape(-1)]
        return self.arm.coupled((theta + self.arm.geometry[3]) * self.arm.direction)

    def within_limits(self, q: Array) -> Array:
        """All postures (M, n) equal to the branches q (K, n) up to full turns, within limits."""
        found = [self._turned_into_limits(branch) for branch in q]
        return np.concatenate(found) if found else np.empty((0, self.arm.n))

    def _turned_into_limits(self, branch: Array) -> Array:
        lower, upper = self.arm.limits.T
        endless = ~np.isfinite(upper - lower)
        first = np.where(endless, 0, np.ceil((lower - branch) / (2 * np.pi)))
        last = np.where(endless, 0, np.floor((upper - branch) / (2 * np.pi)))
        if (first == last).all():
            found: Array = branch[None] + 2 * np.pi * first
        else:
            turns = [np.arange(*ends) for ends in zip(first, last + 1, strict=True)]
            found = branch + 2 * np.pi * np.array(list(product(*turns))).reshape(-1, self.arm.n)
        if self.arm.coupling is None:
            return found
        # a joint that moves by half of another's turn does not come back with it
        turned = self.arm.uncoupled(found - branch) / (2 * np.pi)
        return found[np.abs(turned - np.round(turned)).max(axis=1, initial=0.0) < SAME]

    def _reaches(self, q: Array, T_base_flange: Array) -> NDArrayBool:
        if len(q) == 0:
            return np.zeros(0, dtype=bool)
        off = np.abs(forward_kinematics(self.arm, q) - T_base_flange)
        reached: NDArrayBool = off.max(axis=(1, 2)) <= EXACT
        return reached


def _wrapped(angle: Array) -> Array:
    """Angles in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _distinct(q: Array) -> Array:
    """Postures (K, n) without repetitions: at a singularity branches fall together."""
    kept: list[Array] = []
    for row in q:
        if all(np.abs(_wrapped(row - other)).max() > SAME for other in kept):
            kept.append(row)
    return np.array(kept).reshape(-1, q.shape[1])
