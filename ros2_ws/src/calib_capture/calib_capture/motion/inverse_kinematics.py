# SPDX-License-Identifier: Apache-2.0
"""Every inverse-kinematics branch of an arm, by EAIK's geometric decompositions."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from calib_model.arrays import Array
from calib_model.errors import CalibrationError
from calib_model.instruments import Arm, NDArrayBool
from calib_model.kinematics import forward_kinematics

if TYPE_CHECKING:
    from eaik.IK_DH import DhRobot

EXACT = 1e-9  # m and rad: a solution is one when forward kinematics says so
SAME = 1e-6  # rad: closer postures are the same one
DECOMPOSED_JOINTS = 6


class InverseError(CalibrationError):
    """An arm whose inverse kinematics has no closed form here."""


class InverseKinematics:
    """The postures of an arm that bring its flange to a given pose.

    An arm of seven joints has one of them swept: `redundant` says which (from 0), the others
    follow in closed form.

    Raises:
        InverseError: the arm's geometry has no known decomposition (it needs a spherical wrist
            or three axes that are parallel, no beta, and no joint that slides), or EAIK is not
            installed.
    """

    def __init__(self, arm: Arm, redundant: int = 2) -> None:
        self.arm = arm
        self._redundant = redundant
        self._base_inverse = arm.base_T_dh.inverse().matrix()
        self._flange_inverse = arm.dh_T_flange.inverse().matrix()
        if arm.prismatic.any():
            slides = arm.joint_names[int(np.argmax(arm.prismatic))]
            raise InverseError(
                f'{arm.name}: {slides} slides: plan and capture take arms whose joints all turn'
            )
        if np.any(arm.geometry[4] != 0.0):
            raise InverseError(f'{arm.name}: no inverse kinematics for an arm with beta')
        if arm.n not in (DECOMPOSED_JOINTS, DECOMPOSED_JOINTS + 1):
            raise InverseError(f'{arm.name}: inverse kinematics needs 6 or 7 joints, got {arm.n}')
        self._six = self._solver([]) if arm.n == DECOMPOSED_JOINTS else None
        if self._six is None and arm.joints[redundant].coupling is not None:
            swept = arm.joint_names[redundant]
            raise InverseError(f'{arm.name}: {swept} is swept, and moves with another joint')
        probe = self._six or self._solver([(redundant, 0.5)])
        if not probe.hasKnownDecomposition():
            raise InverseError(
                f'{arm.name}: no closed form for its inverse kinematics; expected nominal '
                'parameters with a spherical wrist, not identified ones'
            )

    def _solver(self, fixed: list[tuple[int, float]]) -> DhRobot:
        try:  # rosdep has no key for it, and only planning needs it
            from eaik.IK_DH import DhRobot
        except ModuleNotFoundError as error:
            raise InverseError('this needs EAIK, not installed: pip install EAIK') from error
        a, alpha, d, _, _ = self.arm.geometry
        return DhRobot(alpha, a, d, fixed)

    def redundant_range(self) -> tuple[float, float]:
        """The range of the joint to be swept, rad; without meaning for six joints."""
        lower, upper = np.clip(self.arm.limits[self._redundant], -np.pi, np.pi)
        return float(lower), float(upper)

    def branches(self, T_base_flange: Array, redundant_value: float | None = None) -> Array:
        """Every posture (K, n) in rad, each joint within +-pi, that reaches the pose (4, 4).

        Limits are not applied. An arm of seven joints needs the `redundant_value` (rad).
        """
        solver = self._six
        if solver is None:
            if redundant_value is None:
                raise InverseError(f'{self.arm.name}: seven joints need a value for one of them')
            fixed = self.arm.direction[self._redundant] * redundant_value
            fixed -= self.arm.geometry[3, self._redundant]
            solver = self._solver([(self._redundant, float(fixed))])
        solution = solver.IK(self._base_inverse @ T_base_flange @ self._flange_inverse)
        theta = np.asarray(solution.Q, dtype=np.float64).reshape(-1, self.arm.n)
        # out of reach EAIK answers with the nearest posture, flagged as least squares
        theta = theta[~np.asarray(solution.is_LS, dtype=bool).reshape(-1)]
        q = self.arm.coupled((theta + self.arm.geometry[3]) * self.arm.direction)
        q = _wrapped(q)
        return _distinct(q[self._reaches(q, T_base_flange)])

    def within_limits(self, q: Array) -> Array:
        """All postures (M, n) equal to the branches q (K, n) up to full turns, within limits."""
        found = [self._turned_into_limits(branch) for branch in q]
        return np.concatenate(found) if found else np.empty((0, self.arm.n))

    def _turned_into_limits(self, branch: Array) -> Array:
        choices = []
        for value, (lower, upper) in zip(branch, self.arm.limits, strict=True):
            if not np.isfinite(upper - lower):
                choices.append([float(value)])
                continue
            turns = np.arange(
                np.ceil((lower - value) / (2 * np.pi)), np.floor((upper - value) / (2 * np.pi)) + 1
            )
            choices.append([float(value + 2 * np.pi * turn) for turn in turns])
        found = np.array(list(product(*choices))).reshape(-1, self.arm.n)
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
